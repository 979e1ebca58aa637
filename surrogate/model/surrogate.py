"""`Surrogate`, a trained ensemble: shown, stored and moved as a whole."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

import surrogate
from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import Variation
from catalogs.vocabulary.words import joined_names
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Normalization
from surrogate.model.batches import draw_all, paired, rows_of, warn_of
from surrogate.model.deformed import DeformedGaussians, checked_background
from surrogate.model.differentiable import DifferentiableSurrogate
from surrogate.model.differentiable_field import DifferentiableChoice, DifferentiableField
from surrogate.model.field_model import FOLDER, FieldModel, FieldPoint
from surrogate.model.form import fields_of, stored_form, without_gaussians
from surrogate.model.mean_member import MeanMember, MemberModel
from surrogate.model.places import ParameterPoint, place_of, transfer_place
from surrogate.model.points import AnyPoint, BothPoints
from surrogate.model.representation import BOTH, FIELD, FUNCTION, GAUSSIANS, KINDS, VIEW, RepresentationScores
from surrogate.model.representation import FILE as SCORES
from surrogate.notebook import surrogate_html
from surrogate.rasterizer import Rasterizer
from surrogate.splatting import AUTO
from surrogate.splatting.cuda import usable_device
from surrogate.storage import models
from surrogate.storage.encoding import Encoding


@dataclass(frozen=True, eq=False)
class Surrogate:
    """A trained ensemble.

    Attributes
    ----------
    gaussians : the canonical ones, in normalized coordinates.
    deformation : how the parameters move them.
    space : the parameters' names, units and bounds.
    normalization : between world and normalized coordinates.
    rasterizer : the constants it was trained with.
    background : the colour behind the volume in the images it was trained on; None where they had alpha.
    encodings : of tensors stored in fewer bits, by name in `model.safetensors`; tensors replaced since are stored as they are.
    visualizations : how it follows an isovalue or a transfer function as well, and shows other fields.
    field : an emulator of the ensemble's fields, where the catalog keeps them; it draws the same pictures.
    scores : of both on validation images, by kind of question: each kind is drawn by what did better.
    only : "gaussians", "field" or "both", which then draws all; "" for what did best.
    training : how it came to be: `seconds`, `processor_seconds` (all cores), `steps`, `settings`, `curve`, `fingerprint`, ...

    Examples
    --------
    >>> from blobs import CAMERA, make_run
    >>> from surrogate import Surrogate
    >>> Surrogate.load(make_run() / "surrogate").at(separation=0.83, width=0.27).render(CAMERA).shape
    (128, 128, 4)
    """

    gaussians: AnyGaussians
    deformation: BilinearDeformation
    space: ParameterSpace
    normalization: Normalization
    rasterizer: Rasterizer
    background: tuple[float, float, float] | None = None
    training: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    encodings: Mapping[str, Encoding] = dataclasses.field(default_factory=dict)
    visualizations: tuple[Visualization, ...] = ()
    field: FieldModel | None = None
    scores: RepresentationScores = RepresentationScores()  # noqa: RUF009 - frozen
    only: str = ""

    def using(self, representation: str) -> Surrogate:
        """The same with all pictures drawn by its "gaussians", from its emulated "field", or as the mean image of "both".

        Raises ValueError where it has none.
        """
        if representation not in self.representations:
            raise ValueError(
                f"this surrogate can be drawn by its {joined_names(self.representations)} alone, got {representation!r}"
            )
        return replace(self, only=representation)

    @property
    def representations(self) -> tuple[str, ...]:
        """The ways in which it can be drawn: `GAUSSIANS`, `FIELD`, and `BOTH` where it holds them."""
        if self.field is None:
            return (GAUSSIANS,)
        return (GAUSSIANS, FIELD, BOTH) if len(self.gaussians) else (FIELD,)

    @property
    def base_appearance(self) -> str:
        """The name of the appearance that it shows without visualization parameters; "" where nobody said."""
        return str(self.training.get("appearance", next((v.base for v in self.variations), "")))

    def representation(self, kind: str) -> str:
        """The one of `representations` that draws pictures of a kind of question."""
        chosen = self.only or self.scores.better(kind)
        return chosen if chosen in self.representations else self.representations[0]

    def kind(self, parameters: Iterable[str], *, under: bool = False) -> str:
        """The kind of question that `at` with parameters of these names is, or `under` a transfer function."""
        kinds = (v.kind for v in self.variations if not set(v.argument_names).isdisjoint(parameters))
        return FUNCTION if under else next(kinds, VIEW)

    def drawn_by(self, parameters: Iterable[str], *, under: bool = False) -> str:
        """The one of `representations` that draws such a question."""
        return self.representation(self.kind(parameters, under=under))

    def at(
        self, values: Mapping[str, Any] | None = None, /, *, outside: Any = "warn", **parameters: float | str
    ) -> MemberModel:
        """The ensemble at `parameters`, those of the simulation all by name, in their units.

        Names that Python or this function has another use for, such as `lambda` or `outside`, go into the mapping `values`.

        Without more it has the base appearance.  The visualization parameters of one variation may follow: an `isovalue`, or the
        name of another `appearance` that was learnt, such as one of another field.  Displacements of the base transfer function's
        inner control points are zero where they are left out; `under` takes any other transfer function.

        Raises ValueError for missing, unknown or non-finite ones, or where no variation has them; warns where one lies out of
        bounds, unless `outside` is "allow".
        """
        return self._at(self.place(self._named(values, parameters), outside), outside)

    def under(
        self,
        transfer_function: TransferFunction,
        values: Mapping[str, float] | None = None,
        /,
        *,
        outside: Any = "warn",
        **parameters: float,
    ) -> MemberModel:
        """The ensemble at simulation `parameters`, and `values` as in `at`, under any transfer function, in opacity and colour.

        What no training function showed is a guess.  Raises ValueError where the surrogate knows no field values (it then learnt
        colours, or transfer functions by their displacements), or as `at` does.
        """
        return self._at(self.place(self._named(values, parameters), outside, transfer_function), outside)

    def _named(self, values: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """The parameters of both; raises ValueError where `values` are not by name."""
        if values is not None and not isinstance(values, Mapping):
            raise ValueError(f"parameters are values by name, for {', '.join(self.space.names)}, got {values!r}")
        return {**(values or {}), **parameters}

    def render(
        self,
        parameters: Any,
        cameras: Camera | Sequence[Camera],
        *,
        background: Sequence[float] | None = None,
        outside: Any = "warn",
        transfer_function: TransferFunction | None = None,
    ) -> NDArray[np.float32]:
        """B pictures at once, (B, H, W, 4) float32 premultiplied RGBA: each is what `at(...).render(...)` gives, bit for bit.

        Parameters
        ----------
        parameters : (B, P) in the order of `space`, as an array, a tensor or nested lists.  Or names with (B,) values, or one value
            for all, such as {"Re": [1600, 1800], "isovalue": 5.5}.  Or a list of B mappings, which may differ in their names.
        cameras : one for all, or B of equal size; where `parameters` has one row, that member is seen by all cameras.
        background, outside : as in `render` and `at` of one picture.
        transfer_function : any, as in `under`.

        All cores work side by side, a picture each, and one member is deformed a few times at most however many cameras see it.
        Raises ValueError as `at` does, and where lengths or sizes do not fit, before anything is drawn.
        """
        colour = checked_background(background)
        rows, views, size = paired(rows_of(self.space, parameters), cameras)
        points: dict[str, AnyPoint] = {}
        places = []
        for row in rows:
            key = repr(sorted(row.items()))
            if key not in points:
                points[key] = self.place(row, outside, transfer_function)
            places.append(points[key])
        if outside == "warn":
            warn_of(places, stacklevel=2)
        side_by_side = not self.gaussians.means.is_cuda
        return draw_all(places, views, size, self._member, colour, side_by_side=side_by_side)

    def differentiable(
        self, device: str | torch.device = "cpu", *, dtype: torch.dtype = torch.float32, edges: bool = True
    ) -> DifferentiableSurrogate | DifferentiableField | DifferentiableChoice:
        """A torch module whose pictures, those of `at`, have gradients by parameters and more.

        Like `at` it draws by what did better at that kind of question, or by what `using` named.  Gaussians have gradients by the
        camera's pose and all that was trained as well, the emulated field by a transfer function's control points.

        Parameters
        ----------
        device : "cpu", whose gradients are those of the C++ kernels, or "cuda", of gsplat, which draws Gaussians alone.
        dtype : float32, or float64, which plain torch draws: slow, and the definition.
        edges : False for derivatives of single pixels, up to a quarter too small over a picture; gsplat has these alone.

        Raises as `to`, and ValueError for other types, or an emulated field on "cuda".  The numbers are copies.
        """
        if dtype not in (torch.float32, torch.float64):
            raise ValueError(f"dtype must be torch.float32 or torch.float64, got {dtype}")
        drawn_by = {self.representation(kind) for kind in KINDS}
        if self.field is None or drawn_by == {GAUSSIANS}:
            return self._differentiable_gaussians(device, dtype, edges)
        if torch.device(device).type != "cpu":
            raise ValueError(f'an emulated field is drawn on "cpu", not on {str(device)!r}: take `using("gaussians")`')
        field = DifferentiableField(self.field, dtype)
        if drawn_by == {FIELD}:
            return field
        return DifferentiableChoice(self._differentiable_gaussians(device, dtype, edges), field, self.drawn_by)

    def _differentiable_gaussians(self, device: Any, dtype: torch.dtype, edges: bool) -> DifferentiableSurrogate:
        moved, rasterizer = self.to(device), replace(self.rasterizer.for_any_device(), edges=edges)
        return DifferentiableSurrogate(
            moved.gaussians.to(dtype),
            moved.deformation.to(dtype),
            [v.to(dtype) for v in moved.visualizations],
            self.space,
            self.normalization,
            replace(rasterizer, backend="reference") if dtype == torch.float64 else rasterizer,
        )

    def show(self, run: str | os.PathLike[str] | None = None, *, height: int = 720, base_url: str | None = None) -> Any:
        """Explore this surrogate in Jupyter, `height` pixels tall; needs the extra `[explore]`.

        With the folder of its `run` (such as "runs/tgv") the page also shows the stored pictures beside it.  `base_url` is
        that of a Jupyter server with jupyter-server-proxy, where the browser can't reach this machine; JupyterHub tells its own.
        What comes back has an `address`, and `close` stops it.
        """
        return surrogate.show(self, run, height=height, base_url=base_url)

    @property
    def variations(self) -> tuple[Variation, ...]:
        """The variations that it follows."""
        return self.field.variations if self.field is not None else tuple(v.variation for v in self.visualizations)

    @property
    def visualization_names(self) -> tuple[str, ...]:
        """The visualization parameters that `at` takes."""
        return tuple(name for variation in self.variations for name in variation.argument_names)

    def place(self, parameters: Mapping[str, Any], outside: Any, function: TransferFunction | None = None) -> AnyPoint:
        """The point that `at`, or `under` a `function`, draws; its `warnings` say what is out of bounds.  Raises as these do."""
        drawn_by = self.drawn_by(parameters, under=function is not None)
        if self.field is None or drawn_by == GAUSSIANS:
            return self._gaussian_place(parameters, outside, function)
        point = self.field.point(parameters, outside, function)
        if drawn_by == FIELD:
            return point
        return BothPoints(self._gaussian_place(parameters, "allow", function), point)

    def _gaussian_place(
        self, parameters: Mapping[str, Any], outside: Any, function: TransferFunction | None
    ) -> ParameterPoint:
        if function is None:
            return place_of(self.space, self.visualizations, parameters, outside)
        carried = isinstance(self.gaussians, FieldGaussians)
        return transfer_place(self.space, self.visualizations, parameters, function, outside, carried=carried)

    def _at(self, place: AnyPoint, outside: Any) -> MemberModel:
        """The ensemble there; warns, at the line of the caller's caller, unless `outside` is "allow"."""
        if outside == "warn":
            for sentence in place.warnings:
                warnings.warn(sentence, stacklevel=3)
        return self._member(place)

    def _member(self, place: AnyPoint) -> MemberModel:
        if isinstance(place, FieldPoint):
            assert self.field is not None
            return self.field.member(place)
        if isinstance(place, BothPoints):
            assert self.field is not None
            emulation = self.field.member(place.field)
            return MeanMember(self._gaussian_member(place.gaussians, emulation), emulation)
        emulated = None if self.field is None else self.field.member(self.field.point(place.parameters, "allow"))
        return self._gaussian_member(place, emulated)

    def _gaussian_member(self, place: ParameterPoint, emulated: Any) -> DeformedGaussians:
        deformed = place.deform(self.gaussians, self.deformation)
        return DeformedGaussians(deformed, place.parameters, self.normalization, self.rasterizer, emulated)

    def to(self, device: str | torch.device) -> Surrogate:
        """The same on another device, which draws it: "cpu", or "cuda", which needs the extra `[cuda]` and draws by gsplat.

        Raises RuntimeError saying what is missing where there is no such device, ValueError for other kinds of devices.
        """
        moved = usable_device(device)
        return replace(
            self,
            gaussians=self.gaussians.to(moved),
            deformation=self.deformation.to(moved),
            rasterizer=replace(self.rasterizer, backend=AUTO),
            visualizations=tuple(v.to(moved) for v in self.visualizations),
        )

    @property
    def megabytes(self) -> float:
        """Size of all tensors as they are stored, 10^6 bytes."""
        return self.sizes[self.representations[-1]]

    @property
    def sizes(self) -> dict[str, float]:
        """That of each of `representations`, 10^6 bytes."""
        each = {GAUSSIANS: stored_form(self).megabytes, FIELD: 0.0 if self.field is None else self.field.megabytes}
        each[BOTH] = sum(each.values())
        return {name: each[name] for name in self.representations}

    @property
    def digest(self) -> str:
        """A SHA-256 over all that is stored of the model, and over what draws each kind of question."""
        own = stored_form(self).digest
        if self.field is None:
            return own
        drawn_by = [self.representation(kind) for kind in KINDS]
        return hashlib.sha256(" ".join([own, self.field.digest, *drawn_by]).encode()).hexdigest()

    @staticmethod
    def exists(directory: str | os.PathLike[str]) -> bool:
        """True where `directory` holds a finished surrogate: its Gaussians, an emulator of its fields, or both."""
        return models.exists(directory) or FieldModel.exists(directory)

    def save(self, directory: str | os.PathLike[str]) -> None:
        """Write `model.safetensors`, then `model.json`, which makes it a surrogate, into `directory`.

        An emulator of the fields goes into a folder of its own there, and scores into another file.  What this surrogate does not
        hold, such as the emulator of one that was there before, is deleted.
        """
        if self.field is None:
            models.remove(Path(directory) / FOLDER)
            (Path(directory) / SCORES).unlink(missing_ok=True)
        else:
            self.field.save(directory)
            self.scores.save(directory)
        if len(self.gaussians):
            stored_form(self).save(directory)
        else:
            models.remove(directory)

    @classmethod
    def load(cls, directory: str | os.PathLike[str]) -> Surrogate:
        """The surrogate that was saved into `directory`; the folder may come from anyone, for nothing in it is run.

        Raises FileNotFoundError where there is none, ValueError for one of a newer schema and, naming the part, for one that is
        damaged.
        """
        field = FieldModel.load(directory) if FieldModel.exists(directory) else None
        scores = RepresentationScores() if field is None else RepresentationScores.load(directory)
        if field is not None and not models.exists(directory):
            return cls(**without_gaussians(field), field=field, scores=scores)
        loaded = models.load(directory, lambda model: cls(**fields_of(model)))
        if field is not None and field.training.get("fingerprint") != loaded.training.get("fingerprint"):
            raise ValueError(f"{directory} holds Gaussians and an emulator of different runs: copy both of one again")
        return loaded if field is None else replace(loaded, field=field, scores=scores)

    @classmethod
    def of_bytes(cls, tensors: bytes, record: bytes, device: str = "cpu", **more: Any) -> Surrogate:
        """The surrogate whose two files hold these bytes, on a device, with `more` of its attributes.

        Raises ValueError as `load` does, RuntimeError as `to`.
        """
        loaded = models.of_contents(tensors, record, lambda model: cls(**{**fields_of(model), **more}))
        return loaded if device == "cpu" else loaded.to(device)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles, copies and what goes to other processes hold the bytes that `save` writes, and the device."""
        more: dict[str, Any] = {"field": self.field, "scores": self.scores, "only": self.only}
        return partial(type(self).of_bytes, **more), (*stored_form(self).contents(), str(self.gaussians.means.device))

    def _following(self) -> str:
        kinds = " and ".join(v.name for v in self.variations if v.continuous)
        others = ", ".join(s.appearance for v in self.variations if not v.continuous for s in v.settings)
        return (f"any {kinds}, " if kinds else "") + (f"also as {others}, " if others else "")

    def __repr__(self) -> str:
        bounds = ", ".join(
            f"{p.name} {p.text(p.low)}..{p.text(p.high)} {p.unit}".strip() for p in self.space.parameters
        )
        count, field = len(self.gaussians), self.field
        gaussians = f"{count:,} Gaussians, {self.deformation.kind} deformation, " if count else ""
        whole = gaussians if field is None else f"emulated field of {field.megabytes:.1f} MB, {gaussians}"
        return f"<Surrogate of {bounds or 'one member'}: {whole}{self._following()}{self.megabytes:.1f} MB>"

    def _repr_html_(self) -> str:
        """The same for notebooks, with a picture at the middle of the parameters."""
        return surrogate_html(self)
