"""A trained surrogate: Gaussians and their deformation, ready to be looked at from anywhere at any parameters."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

import surrogate
from catalogs.appearance import TransferFunction
from catalogs.cameras import Camera
from catalogs.parameters import ParameterSpace
from surrogate.deformation import Deformation, load_deformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians, Normalization
from surrogate.notebook import deformed_html, surrogate_html
from surrogate.rasterizer import Rasterizer
from surrogate.splatting import AUTO
from surrogate.storage import models
from surrogate.storage.encoding import Encoding
from surrogate.storage.names import joined


@dataclass(frozen=True, eq=False)
class DeformedGaussians:
    """The Gaussians of one member: `render` shows them; world units everywhere.

    Made by `Surrogate.at`; nothing here depends on the parameters any more, so moving the camera costs only drawing.
    """

    gaussians: Gaussians  # in normalized coordinates
    parameters: Mapping[str, float | str]  # those of the simulation, and of the visualization where they were given
    normalization: Normalization
    rasterizer: Rasterizer

    def render(self, camera: Camera, *, background: Sequence[float] | None = None) -> NDArray[np.float32]:
        """The picture that `camera` (world units) sees, (H, W, 4) float32 premultiplied RGBA in [0, 1].

        With a `background` (red, green, blue) it is opaque: composited on that colour, alpha 1.
        """
        with torch.no_grad():
            rendering = self.rasterizer.draw(self.gaussians, self.normalization.camera(camera))
        color, alpha = rendering.color.cpu().numpy(), rendering.alpha.cpu().numpy()[..., None]  # [H, W, 3], [H, W, 1]
        if background is not None:
            color = color + (1.0 - alpha) * np.asarray(background, dtype=np.float32)
            alpha = np.ones_like(alpha)
        return np.clip(np.concatenate([color, alpha], axis=-1), 0.0, 1.0)

    @property
    def means(self) -> NDArray[np.float64]:
        """Centres in world units, (N, 3)."""
        return self.gaussians.means.double().cpu().numpy() * self.normalization.extent + self.normalization.center

    @property
    def scales(self) -> NDArray[np.float64]:
        """Standard deviations along the principal axes in world units, (N, 3)."""
        return self.gaussians.scales().double().cpu().numpy() * self.normalization.extent

    @property
    def opacities(self) -> NDArray[np.float32]:
        """Opacities, (N,)."""
        return self.gaussians.opacities().cpu().numpy()

    def __len__(self) -> int:
        return len(self.gaussians)

    def __repr__(self) -> str:
        values = {name: f"{v:g}" if not isinstance(v, str) else repr(v) for name, v in self.parameters.items()}
        at = ", ".join(f"{name}={value}" for name, value in values.items())
        return f"<DeformedGaussians at {at or 'no parameters'}: {len(self):,} Gaussians>"

    def _repr_html_(self) -> str:
        """The same for notebooks, with a picture."""
        return deformed_html(self)


@dataclass(frozen=True, eq=False)
class Surrogate:
    """A trained ensemble.

    >>> picture = Surrogate.load("runs/tgv-dvr/surrogate").at(Re=1830.0).render(camera)   # doctest: +SKIP
    >>> picture = Surrogate.load("runs/tgv-iso/surrogate").at(Re=1830.0, isovalue=5.5).render(camera)   # doctest: +SKIP
    >>> surrogate = Surrogate.load("runs/tiny-fields/surrogate")   # doctest: +SKIP
    >>> picture = surrogate.at(Re=1830.0, appearance="speed-dvr").render(camera)   # doctest: +SKIP

    Attributes
    ----------
    gaussians : the canonical ones, in normalized coordinates.
    deformation : how the parameters move them.
    space : the parameters' names, units and bounds.
    normalization : between world and normalized coordinates.
    rasterizer : the constants it was trained with.
    background : the colour behind the volume in the images it was trained on; None where they had alpha.
    encodings : of tensors that are stored in fewer bits, by the names they have in `model.safetensors`; the tensors themselves
        are what these decode to.  One that was replaced since is stored as it is.
    visualizations : how it follows an isovalue or a transfer function as well, and shows other fields.
    training : how it came to be: `seconds`, `steps`, `settings`, `curve`, `appearance`, `fingerprint`.
    """

    gaussians: Gaussians
    deformation: Deformation
    space: ParameterSpace
    normalization: Normalization
    rasterizer: Rasterizer
    background: tuple[float, float, float] | None = None
    training: Mapping[str, Any] = field(default_factory=dict)
    encodings: Mapping[str, Encoding] = field(default_factory=dict)
    visualizations: tuple[Visualization, ...] = ()

    def at(self, *, outside: Any = "warn", **parameters: float | str) -> DeformedGaussians:
        """The ensemble at `parameters`, those of the simulation all by name, in their units.

        Without more it looks as the base appearance does.  The visualization parameters of one variation may follow, all of
        them: an `isovalue`; the displacements of the base transfer function's inner control points (those left out are
        zero), beside which `under` takes any other transfer function; or the name of another `appearance` that was learnt, such
        as one of another field.

        Raises ValueError for missing, unknown or non-finite ones, or where no variation has them; warns where one lies out of
        bounds, unless `outside` is "allow".
        """
        of_vis = self.visualization_names
        varied = {n: v for n, v in parameters.items() if n in of_vis}
        simulation = {n: v for n, v in parameters.items() if n not in varied}
        normalized, named = self._placed(self.space.values(simulation, outside=outside, stacklevel=2))
        with torch.no_grad():
            if varied:
                visualization = self._varying(varied)
                more = visualization.variation.values_of(varied, outside=outside, stacklevel=2)  # [V]
                named |= dict.fromkeys(visualization.variation.asked_names, 0.0) | varied
                place = torch.from_numpy(visualization.variation.normalize(more)).to(torch.float32)  # [V]
                both = torch.cat([normalized, place])  # [P + V]
                deformed = visualization.gaussians_at(self.gaussians, self.deformation, both)
            else:
                deformed = self.deformation.deformed(self.gaussians, normalized)
        return DeformedGaussians(deformed, named, self.normalization, self.rasterizer)

    def under(
        self, transfer_function: TransferFunction, /, *, outside: Any = "warn", **parameters: float
    ) -> DeformedGaussians:
        """The ensemble at simulation `parameters` under any transfer function, in opacity and colour.

        What the training functions did not show is a guess.  Raises ValueError where the surrogate
        knows no field values (it then learnt transfer functions by their displacements, or none), or as `at` does.
        """
        normalized, named = self._placed(self.space.values(parameters, outside=outside, stacklevel=2))
        known = [v for v in self.visualizations if v.variation.edits_base]
        if not known:
            raise ValueError(
                "this surrogate has learnt no transfer functions: its scene needs a [[variation]] of that kind"
            )
        with torch.no_grad():
            deformed = known[0].under(self.gaussians, self.deformation, normalized, transfer_function)
        return DeformedGaussians(deformed, named, self.normalization, self.rasterizer)

    def show(self, run: str | os.PathLike[str] | None = None, *, height: int = 720, base_url: str | None = None) -> Any:
        """Explore this surrogate in Jupyter, `height` pixels tall; needs the extra `[explore]`.

        With the folder of its `run` (such as "runs/tgv-dvr") the page also shows the stored pictures beside it.  `base_url` is
        that of a Jupyter server with jupyter-server-proxy, where the browser can't reach this machine; JupyterHub tells its own.
        What comes back has an `address`, and `close` stops it.
        """
        return surrogate.show(self, run, height=height, base_url=base_url)

    @property
    def visualization_names(self) -> tuple[str, ...]:
        """The visualization parameters that `at` takes."""
        return tuple(name for v in self.visualizations for name in v.variation.asked_names)

    def _placed(self, values: NDArray[np.float64]) -> tuple[torch.Tensor, dict[str, float | str]]:
        """Simulation parameters (P,) as the deformation takes them, (P,) float32, and by name."""
        normalized = torch.from_numpy(self.space.normalize(values)).to(torch.float32)  # [P]
        return normalized, dict(zip(self.space.names, values.tolist(), strict=True))

    def _varying(self, parameters: Mapping[str, float | str]) -> Visualization:
        """That whose variation has all these parameters."""
        for visualization in self.visualizations:
            if set(parameters) <= set(visualization.variation.asked_names):
                return visualization
        raise ValueError(f"parameters {sorted(parameters)} belong to different variations: set those of one")

    def to(self, device: str | torch.device) -> Surrogate:
        """The same on another device, which draws it: "cuda" needs the extra `[cuda]`, and then draws by gsplat."""
        moved = torch.device(device)
        return replace(
            self,
            gaussians=self.gaussians.to(moved),
            deformation=self.deformation.to(moved),
            rasterizer=replace(self.rasterizer, backend=AUTO),
            visualizations=tuple(v.to(moved) for v in self.visualizations),
        )

    @property
    def megabytes(self) -> float:
        """Size of the model's tensors as they are stored, 10^6 bytes."""
        return self._stored().megabytes

    @property
    def digest(self) -> str:
        """A SHA-256 over all that is stored of the model."""
        return self._stored().digest

    @staticmethod
    def exists(directory: str | os.PathLike[str]) -> bool:
        """Whether `directory` holds a finished surrogate."""
        return models.exists(directory)

    def save(self, directory: str | os.PathLike[str]) -> None:
        """Write `model.safetensors`, then `model.json`, which makes it a surrogate, into `directory`."""
        self._stored().save(directory)

    @classmethod
    def load(cls, directory: str | os.PathLike[str]) -> Surrogate:
        """The surrogate that was saved into `directory`.

        Raises FileNotFoundError where there is none, ValueError for one of a newer schema or whose files are damaged.
        """
        return models.load(directory, cls._of)

    @classmethod
    def _of(cls, stored: models.StoredModel) -> Surrogate:
        record = stored.record
        visualizations = record.get("visualizations", [])
        names = ("gaussians", "deformation", *(f"visualization{i}" for i in range(len(visualizations))))
        parts: dict[str, dict[str, torch.Tensor]] = {name: {} for name in names}
        for name, tensor in stored.tensors.items():
            part, key = name.split(".", 1)
            parts[part][key] = tensor
        background = record["background"]
        return cls(
            gaussians=Gaussians(**parts["gaussians"]),
            deformation=load_deformation(parts["deformation"], record["deformation"]),
            space=ParameterSpace.from_json(record["parameters"]),
            normalization=Normalization.from_json(record["normalization"]),
            rasterizer=Rasterizer.from_json(record["rasterizer"]),
            background=None if background is None else tuple(background),
            training=record["training"],
            encodings=stored.encodings,
            visualizations=tuple(
                Visualization.load(parts[f"visualization{i}"], form) for i, form in enumerate(visualizations)
            ),
        )

    def _stored(self) -> models.StoredModel:
        parts = {"gaussians": self.gaussians.tensors(), "deformation": self.deformation.stored()}
        parts |= {f"visualization{i}": v.stored() for i, v in enumerate(self.visualizations)}
        continuous = all(v.variation.continuous for v in self.visualizations)
        record = {
            "schema": models.WITHOUT_FIELDS if continuous else models.SCHEMA,
            "parameters": self.space.to_json(),
            "normalization": self.normalization.to_json(),
            "deformation": self.deformation.record(),
            "rasterizer": self.rasterizer.to_json(),
            "background": self.background,
            "training": dict(self.training),
            "visualizations": [v.record() for v in self.visualizations],
        }
        return models.StoredModel(joined(parts), record, self.encodings)

    def _following(self) -> str:
        variations = [v.variation for v in self.visualizations]
        kinds = [v.name for v in variations if v.continuous]
        others = [s.appearance for v in variations if not v.continuous for s in v.settings]
        following = f"any {' and '.join(kinds)}, " if kinds else ""
        return following + (f"also as {', '.join(others)}, " if others else "")

    def __repr__(self) -> str:
        bounds = ", ".join(f"{p.name} {p.low:g}..{p.high:g} {p.unit}".strip() for p in self.space.parameters)
        return (
            f"<Surrogate of {bounds or 'one member'}: {len(self.gaussians):,} Gaussians, "
            f"{self.deformation.kind} deformation, {self._following()}{self.megabytes:.1f} MB>"
        )

    def _repr_html_(self) -> str:
        """The same for notebooks, with a picture at the middle of the parameters."""
        return surrogate_html(self)
