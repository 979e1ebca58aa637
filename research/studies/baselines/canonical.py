"""Canonical Gaussians fitted to the images of all members at once: the start of methods that deform Gaussians.

Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field Rendering", with relocation in place of densification, so
that their number is known beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from research.studies.baselines.method import TrainingImages
from research.studies.baselines.spherical_harmonics import C0, harmonics
from research.studies.baselines.spherical_harmonics import COUNT as BASIS
from surrogate.initialization.pictures import StartPoints
from surrogate.initialization.start import initial_gaussians
from surrogate.randomness import generator
from surrogate.settings import TrainingSettings
from surrogate.splatting import Constants, Primitives, draw_over
from surrogate.training.data import Example, foreground_color
from surrogate.training.loop import Diverged, first_infinite
from surrogate.training.losses import image_loss
from surrogate.training.optimizer import Adam
from surrogate.training.relocation import STOP, plan_relocation, relocate
from surrogate.training.sampling import ShuffledEpochs

COUNT, STEPS = 20_000, 10_000
DEGREE = 3  # of the colours' spherical harmonics
DEGREES_PER_TRAINING = 30  # degrees increase every 1000 of 30,000 steps
MEAN_RATE = 1.6e-4  # of the extent of the cameras
RATES = {"log_scales": 5e-3, "quats": 1e-3, "opacity_logits": 5e-2, "base_colors": 2.5e-3, "directional": 2.5e-3 / 20.0}
FINAL_FACTOR = 0.01  # of the means' rate, reached exponentially
RELOCATION_INTERVAL = TrainingSettings().relocation_interval
COLOR_SAMPLES = 16  # images whose mean is the initial colour
BLACK = (0.0, 0.0, 0.0)

Leaves: TypeAlias = dict[str, Tensor]


@dataclass(frozen=True, eq=False)
class HarmonicGaussians:
    """N Gaussians in unconstrained parameters (float32), whose colours depend on the direction by harmonics of degree 3.

    Attributes
    ----------
    means, log_scales, quats, opacity_logits : (N, 3), (N, 3), (N, 4), (N,), as of `surrogate.gaussians.Gaussians`.
    harmonics : (N, 16, 3), coefficients of the colour less 0.5, in the order of `spherical_harmonics.harmonics`.
    """

    means: Tensor  # [N, 3]
    log_scales: Tensor  # [N, 3]
    quats: Tensor  # [N, 4]
    opacity_logits: Tensor  # [N]
    harmonics: Tensor  # [N, 16, 3]

    def __len__(self) -> int:
        return len(self.means)

    @classmethod
    def of_tensors(cls, tensors: Mapping[str, Tensor]) -> HarmonicGaussians:
        """The Gaussians with these `tensors()`; other names are ignored. Raises KeyError naming a missing one."""
        return cls(**{field.name: tensors[field.name] for field in fields(cls)})

    def tensors(self) -> dict[str, Tensor]:
        """The parameters by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def colors_from(self, position: Tensor, degree: int = DEGREE) -> Tensor:
        """Colours (N, 3), not negative, as seen from `position` (3,), of the harmonics up to a degree (official code)."""
        directions = torch.nn.functional.normalize(self.means - position, dim=1)  # [N, 3]
        used = (degree + 1) ** 2
        basis = harmonics(directions)[:, :used]  # [N, K]
        return ((basis.unsqueeze(1) @ self.harmonics[:, :used]).squeeze(1) + 0.5).clamp(min=0.0)

    def draw_over(self, camera: Camera, background: Sequence[float], *, degree: int = DEGREE) -> Tensor:
        """Colours over `background` (3,) and alpha, (H, W, 4); differentiable in all tensors.

        Raises `Diverged` where a number is not finite.
        """
        position = torch.from_numpy(camera.position).to(self.means)  # [3]
        colors = self.colors_from(position, degree)  # [N, 3]
        shapes = self.means, self.log_scales.exp(), self.quats
        primitives = Primitives(*shapes, self.opacity_logits.sigmoid(), colors)
        try:
            return draw_over(primitives, camera, background, Constants())
        except ValueError as error:
            if not first_infinite(primitives._asdict()):
                raise
            raise Diverged(f"training diverged: {error}") from None

    @torch.no_grad()
    def picture(self, camera: Camera, background: Sequence[float] | None) -> NDArray[np.float32]:
        """The premultiplied RGBA image (H, W, 4) in [0, 1]; over a `background` (3,), if given, with alpha 1.

        Colours are clipped to valid RGBA: no channel exceeds alpha.
        """
        picture = self.draw_over(camera, BLACK if background is None else background)  # [H, W, 4]
        if background is not None:
            picture[..., 3] = 1.0
        return torch.minimum(picture.clamp(min=0.0), picture[..., 3:]).cpu().numpy()


def prepare(pictures: TrainingImages, seed: int, *, count: int = COUNT, steps: int = STEPS) -> dict[str, Tensor]:
    """Tensors of `count` frozen Gaussians that fit the images of all members best, learnt in `steps` steps."""
    leaves = leaves_of(initial(pictures, seed, count))
    adam = optimizer(leaves, extent_of(pictures.cameras))
    order = ShuffledEpochs(len(pictures), seed)
    for step in range(steps):
        picture, fraction = order[step], step / steps
        degree = degree_at(fraction)
        drawn = of_leaves(leaves).draw_over(pictures.camera(picture), pictures.behind, degree=degree)  # [H, W, 4]
        image_loss(drawn, compared(pictures, picture).to(drawn.device)).backward()
        adam.step(1.0, {"means": decay(fraction)})
        if (step + 1) % RELOCATION_INTERVAL == 0 and fraction < STOP:
            revive(leaves, adam, seed, step + 1)
    return {name: tensor.detach() for name, tensor in of_leaves(leaves).tensors().items()}


def initial(pictures: TrainingImages, seed: int, count: int) -> HarmonicGaussians:
    """Gaussians on the images' points, otherwise anywhere in their box, with the same colour from everywhere."""
    points = None
    if pictures.points is not None and len(pictures.points):
        colors = None if pictures.point_colors is None else _float64(pictures.point_colors)
        points = StartPoints(_float64(pictures.points), colors)
    some = [example(pictures, picture) for picture in range(0, len(pictures), max(1, len(pictures) // COLOR_SAMPLES))]
    settings, color = TrainingSettings(gaussians=count, seed=seed), foreground_color(some, pictures.background)
    start = initial_gaussians(settings, _float64(pictures.box), points, color)
    coefficients = torch.zeros(count, BASIS, 3)  # [N, 16, 3]
    coefficients[:, 0] = (start.tensors()["colors"] - 0.5) / C0
    gaussians = HarmonicGaussians(start.means, start.log_scales, start.quats, start.opacity_logits, coefficients)
    return HarmonicGaussians(**{name: t.to(pictures.box.device) for name, t in gaussians.tensors().items()})


def extent_of(cameras: Sequence[Camera]) -> float:
    """The unit of length of 3DGS: 1.1 times the largest distance of a camera from the middle of all (official code).

    At least 1, half the box: for a single camera it would be 0, and nothing would move.
    """
    positions = np.array([camera.position for camera in cameras])  # [V, 3]
    return max(1.0, 1.1 * float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).max()))


def leaves_of(gaussians: HarmonicGaussians) -> Leaves:
    """Leaf tensors to train by name: as in `tensors()`, but colours in two, `base_colors` (N, 3) and `directional` (N, 45)."""
    tensors = gaussians.tensors()
    coefficients = tensors.pop("harmonics").flatten(1)  # [N, 48]
    tensors |= {"base_colors": coefficients[:, :3], "directional": coefficients[:, 3:]}
    return {name: t.detach().clone().contiguous().requires_grad_() for name, t in tensors.items()}


def of_leaves(leaves: Mapping[str, Tensor]) -> HarmonicGaussians:
    """The Gaussians that `leaves_of` took apart, differentiable in the leaves."""
    coefficients = torch.cat([leaves["base_colors"], leaves["directional"]], dim=1)  # [N, 48]
    return HarmonicGaussians.of_tensors({**leaves, "harmonics": coefficients.unflatten(1, (BASIS, 3))})


def optimizer(leaves: Leaves, extent: float, rate: float = 1.0) -> Adam:
    """Adam with the rates of 3DGS times `rate`; Gaussians outside an image stay as they are."""
    rates = {name: rate * own for name, own in {"means": MEAN_RATE * extent, **RATES}.items()}
    return Adam(leaves, rates)


def decay(fraction: float) -> float:
    """The factor on the rate of the means after a fraction of the steps."""
    return FINAL_FACTOR**fraction


def degree_at(fraction: float) -> int:
    """The degree of the colours' harmonics after a fraction of the steps."""
    return min(DEGREE, int(DEGREES_PER_TRAINING * fraction))


def example(pictures: TrainingImages, picture: int) -> Example:
    """An image as the surrogate's own training compares it: opaque ones have no alpha."""
    pixels = pictures.pixels[picture][..., : 4 if pictures.background is None else 3]  # [H, W, 3 or 4]
    return Example(pictures.camera(picture), pictures.parameters[picture], np.ascontiguousarray(pixels))


def compared(pictures: TrainingImages, picture: int) -> Tensor:
    """Colours over `pictures.behind`, and alpha where pictures have any, of one of them: (H, W, 3 or 4) uint8."""
    return torch.from_numpy(np.ascontiguousarray(example(pictures, picture).compared()))


@torch.no_grad()
def revive(leaves: Leaves, adam: Adam, seed: int, step: int) -> None:
    """Move invisible Gaussians to visible ones, in place."""
    opacities = leaves["opacity_logits"].sigmoid()  # [N]
    relocation = plan_relocation(opacities, generator(seed, "relocation", step))
    if relocation is not None:
        relocate(relocation, leaves, adam.moments())


def _float64(tensor: Tensor) -> NDArray[np.float64]:
    return tensor.detach().cpu().numpy().astype(np.float64)
