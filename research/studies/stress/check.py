"""Compare backends with the float64 reference implementation on the hard cases."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from research.studies.stress.cases import BitwiseCase, Refusal, StressCase, agreements, cases, refusals
from research.studies.stress.scenes import NEAR, cloud, tied, view
from surrogate.splatting import BACKENDS, Constants, Primitives, draw, reference

MARGIN = 2e-4  # relative distance to a threshold within which float32 may fall to the other side
PIXELS_AT_ONCE = 512
CROWD = 3000  # Gaussians: enough for every thread to have several portions

Backend = Mapping[str, Any]  # options of `surrogate.splatting.render`


class PictureAndGradients(NamedTuple):
    """An image, and the gradients of a fixed random functional of it by attribute."""

    picture: Tensor  # [H, W, 5]: colour, alpha, depth
    gradients: Primitives


@dataclass(frozen=True)
class CaseOutcome:
    """The outcome of one case.

    Attributes
    ----------
    image : largest error where a pixel is certain.
    gradients : largest error by attribute, relative to the largest of its kind.
    finite : False if any number is NaN or infinite.
    uncertain : share of pixels with a contribution within `MARGIN` of a threshold.
    jump : largest difference of colour or alpha in these pixels.
    complaints : exceeded bounds in words; empty where the case passes.
    """

    case: StressCase | BitwiseCase | Refusal
    image: float = 0.0
    gradients: Mapping[str, float] = field(default_factory=dict)
    finite: bool = True
    uncertain: float = 0.0
    jump: float = 0.0
    complaints: tuple[str, ...] = ()
    pictures: tuple[Tensor, Tensor] | None = None  # [H, W, 5] each: the backend's, the reference's

    @property
    def passed(self) -> bool:
        return not self.complaints


def draw_reference(case: StressCase) -> tuple[Tensor, PictureAndGradients]:
    """The `certain_pixels` of a case, and its image and gradients in float64."""
    scene, camera = snapped(case.scene()), case.camera()
    certain = certain_pixels(scene, camera, case)
    return certain, _drawn(scene, camera, certain, case.constants, {"backend": "reference"})


def check(
    case: StressCase, backend: Backend, reference_result: tuple[Tensor, PictureAndGradients] | None = None
) -> CaseOutcome:
    """Check one case against its bounds; `backend` are options of `surrogate.splatting.render`.

    `reference_result` is that of `draw_reference` for the case, by default drawn here.
    """
    scene, camera = snapped(case.scene()), case.camera()
    certain, true = reference_result or draw_reference(case)
    got = _drawn(Primitives(*(tensor.float() for tensor in scene)), camera, certain, case.constants, backend)
    difference = (got.picture.double() - true.picture).abs() / _units(true.picture)  # [H, W, 5]
    inside, outside = difference[certain], difference[~certain]
    pairs = zip(Primitives._fields, got.gradients, true.gradients, _gradient_units(scene, true.gradients), strict=True)
    outcome = CaseOutcome(
        case,
        _largest(inside),
        {name: _relative(own, other, unit) for name, own, other, unit in pairs},
        all(bool(torch.isfinite(t).all()) for t in (got.picture, *got.gradients)),
        float((~certain).double().mean()),
        _largest(outside),
        pictures=(got.picture.double(), true.picture),
    )
    return replace(outcome, complaints=tuple(_complaints(outcome, case, got.picture)))


def check_agreement(agreement: BitwiseCase, backend: Backend) -> CaseOutcome:
    """Check that an image of many Gaussians at equal depths, and its gradients, do not change by a bit."""
    scene = Primitives(*(tensor.float() for tensor in tied(CROWD)))
    camera, certain = view(130, 90), torch.ones(90, 130, dtype=torch.bool)
    constants = Constants(NEAR)
    first = _drawn(scene, camera, certain, constants, backend)
    changed = Primitives(*(agreement.changed(tensor) for tensor in scene))
    again = _drawn(changed, camera, certain, constants, {**backend, **agreement.options})
    complaints = [] if torch.equal(first.picture, again.picture) else ["the picture differs"]
    complaints += [
        f"the gradient by {name} differs"
        for name, a, b in zip(Primitives._fields, first.gradients, again.gradients, strict=True)
        if not torch.equal(a, b.to(a))
    ]
    return CaseOutcome(agreement, complaints=tuple(complaints))


def check_refusal(refusal: Refusal, backend: Backend) -> CaseOutcome:
    """Check that a non-finite number is refused by name."""
    scene = Primitives(*(tensor.float() for tensor in cloud()))
    getattr(scene, refusal.attribute)[refusal.row] = refusal.value
    try:
        draw(scene, view(), Constants(NEAR), **backend)
    except ValueError as error:
        named = f"{refusal.attribute} of Gaussian {refusal.row}" in str(error)
        return CaseOutcome(refusal, complaints=() if named else (f"the error does not name it: {error}",))
    return CaseOutcome(refusal, complaints=("it was drawn",))


def snapped(primitives: Primitives) -> Primitives:
    """The same Gaussians in float64, rounded to float32, so that the arithmetic alone differs."""
    return Primitives(*(tensor.float().double() for tensor in primitives))


def certain_pixels(scene: Primitives, camera: Camera, case: StressCase) -> Tensor:
    """Pixels (H, W) without a visible contribution within `MARGIN` of the alpha floor or of the least transmittance."""
    constants = case.constants
    splats = reference.project(scene, camera, replace(constants, alpha_floor=case.alpha_floor * (1 - MARGIN)))
    certain = []
    for pixels in reference.pixel_centers(camera).double().split(PIXELS_AT_ONCE):
        densities = reference.densities_at(pixels, splats)  # [P, M]
        drawn = torch.where(densities >= case.alpha_floor, densities.clamp(max=constants.alpha_cap), 0.0)
        reached = reference.transmittances(drawn)  # [P, M]
        on_floor = ((densities / case.alpha_floor - 1).abs() < MARGIN) & (
            reached >= constants.min_transmittance * (1 - MARGIN)
        )
        last = (reached / constants.min_transmittance - 1).abs() < MARGIN
        certain.append(~(on_floor | last).any(dim=1))
    return torch.cat(certain).view(camera.height, camera.width)


def _drawn(
    scene: Primitives, camera: Camera, certain: Tensor, constants: Constants, options: Mapping[str, Any]
) -> PictureAndGradients:
    device = "cuda" if options.get("backend") == "cuda" else "cpu"
    leaves = Primitives(*(tensor.detach().clone().to(device).requires_grad_() for tensor in scene))
    drawn = draw(leaves, camera, constants, depth=True, **options)
    assert drawn.depth is not None
    picture = torch.cat([drawn.color, drawn.alpha[..., None], drawn.depth[..., None]], dim=2).cpu()  # [H, W, 5]
    random = torch.Generator().manual_seed(9)
    weights = torch.randn(picture.shape, generator=random, dtype=torch.float64) * certain[..., None]
    scale = torch.tensor([1.0, 1.0, 1.0, 1.0, 0.0])  # depth is a second image: its gradients are those of a colour
    value = (picture * (weights * scale).to(picture)).sum()
    return PictureAndGradients(
        picture.detach(), Primitives(*(gradient.cpu() for gradient in torch.autograd.grad(value, leaves)))
    )


def _units(picture: Tensor) -> Tensor:
    """Units (5,) of the errors of each channel."""
    largest = picture.abs().amax(dim=(0, 1))  # [5]
    return torch.stack([*largest[:3].clamp(min=1.0), largest.new_tensor(1.0), largest[4].clamp(min=1e-30)])


def _gradient_units(scene: Primitives, gradients: Primitives) -> list[float]:
    """The largest gradient of each kind, the unit of its errors.

    A round Gaussian looks the same in every orientation: its quaternion gradient is a cancelled sum of terms as large
    as the gradients of its log scales. These terms therefore count too.
    """
    largest = dict(zip(Primitives._fields, map(_largest, gradients), strict=True))
    lengths = scene.quats.norm(dim=1, keepdim=True)  # [N, 1]
    turning = gradients.scales * scene.scales / lengths  # [N, 3]
    seen = torch.where(lengths > Constants.shortest_quaternion, turning, 0.0)
    return list((largest | {"quats": max(largest["quats"], _largest(seen))}).values())


def _relative(got: Tensor, true: Tensor, unit: float) -> float:
    error = _largest(got.double() - true)
    return error / unit if error != 0.0 and unit > 0.0 else error


def _largest(tensor: Tensor) -> float:
    """The largest absolute value; 0 for an empty tensor."""
    return float(tensor.abs().max()) if tensor.numel() else 0.0


def _complaints(outcome: CaseOutcome, case: StressCase, picture: Tensor) -> Iterator[str]:
    if not outcome.finite:
        yield "not finite"
    if not outcome.image <= case.image:
        yield f"image error {outcome.image:.1e} above {case.image:.0e}"
    for name, error in outcome.gradients.items():
        if not error <= case.gradient:
            yield f"gradient by {name} wrong by {error:.1e}, above {case.gradient:.0e}"
    # A contribution at a threshold may change the pixel by some alpha floors, one for each on the threshold.
    largest = 4.0 * case.alpha_floor + 2.0 * Constants.min_transmittance
    if not outcome.jump <= largest:
        yield f"jump of {outcome.jump:.1e} at a threshold, above {largest:.1e}"
    if case.expected_alpha is not None:
        middle = float(picture[picture.shape[0] // 2, picture.shape[1] // 2, 3])
        if not abs(middle - case.expected_alpha) <= case.image:
            yield f"alpha {middle:.7f} where the formula says {case.expected_alpha:.7f}"


def tables(
    backends: Mapping[str, Backend], tell: Callable[[str, CaseOutcome], None] = lambda *_: None
) -> dict[str, list[CaseOutcome]]:
    """Check backends, by name, against every case; `tell` receives each outcome. The reference is drawn once per case."""
    compiled = [getattr(BACKENDS.get(b.get("backend", "cpu")), "COMPILED", None) for b in backends.values()]
    floors = {constants["alpha_floor"] for constants in compiled if constants}  # gsplat has but one alpha floor
    outcomes: dict[str, list[CaseOutcome]] = {name: [] for name in backends}
    drawn = (case for case in cases() if floors <= {case.constants.alpha_floor})
    checks: Iterator[Callable[[Backend], CaseOutcome]] = itertools.chain(
        (partial(check, case, reference_result=draw_reference(case)) for case in drawn),
        (partial(check_agreement, row) for row in agreements()),
        (partial(check_refusal, row) for row in refusals()),
    )
    for checked in checks:
        for name, backend in backends.items():
            outcomes[name].append(checked(backend))
            tell(name, outcomes[name][-1])
    return outcomes
