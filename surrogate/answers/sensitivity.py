"""Local sensitivity, or what matters in a picture: its change by each parameter, pixel by pixel, at one place."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.words import one_line
from surrogate.answers.opinions import smaller
from surrogate.answers.small_fields import SmallFields
from surrogate.answers.targets import averaged, inside
from surrogate.emulation.exports import xarray_package
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.model import Surrogate
from surrogate.model.representation import BOTH, FIELD, GAUSSIANS, WORDS

if TYPE_CHECKING:
    import xarray

STEP = 0.01  # of a range, to either side: below it pictures change by single Gaussians that appear or vanish
MOST_STEP = 0.25
VISIBLE = 1.0 / 255.0  # of a colour over a whole range: less is not seen
AGREE = 0.8  # the correlation of maps below which they are called uncertain

Box = tuple[int, int, int, int]
Array = NDArray[np.float32]
Draw = Callable[[Any, Camera], Array]  # of rows of parameters, pictures (B, H, W, 4)


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """The changes of a picture by each parameter.

    Attributes
    ----------
    space : P parameters.
    parameters : where the changes hold, by name.
    picture : (H, W, 3), as displayed, channels from 0 to 1.
    maps : (P, H, W, 3), its derivative by each parameter times the parameter's range, on its scale.
    region : x0, y0, x1, y1 in pixels of a part that is looked at as well.
    agreements : (P,) correlations of the maps with those by another representation; NaN where nothing changes, None without one.
    drawn_by : the words for the representation that drew.
    """

    space: ParameterSpace
    parameters: Mapping[str, Any]
    picture: Array
    maps: Array
    region: Box | None = None
    agreements: NDArray[np.float64] | None = None
    drawn_by: str = ""

    def __repr__(self) -> str:
        ranked = np.argsort(-self.of_view, kind="stable")
        return "<Sensitivity: " + ", ".join(f"{self.space.names[j]} {self.of_view[j]:.3f}" for j in ranked) + ">"

    def to_xarray(self) -> xarray.Dataset:
        """`maps` over parameter, row, column and channel, `picture`, and `agreement` of each map where there is one.

        Raises ModuleNotFoundError without xarray.
        """
        pixels = ("row", "column", "channel")
        named: dict[str, Any] = {"maps": (("parameter", *pixels), self.maps), "picture": (pixels, self.picture)}
        if self.agreements is not None:
            named["agreement"] = ("parameter", self.agreements)
        lines = {"parameter": list(self.space.names), "channel": ["red", "green", "blue"]}
        return xarray_package().Dataset(named, lines, dict(self.parameters))

    @property
    def magnitudes(self) -> Array:
        """The maps' absolute values (P, H, W), mean over channels."""
        return np.abs(self.maps).mean(-1)

    @property
    def of_view(self) -> NDArray[np.float64]:
        """Mean magnitudes (P,) over all pixels."""
        return self.magnitudes.mean((1, 2), dtype=np.float64)

    @property
    def of_region(self) -> NDArray[np.float64] | None:
        """Mean magnitudes (P,) over the region's pixels; None without one."""
        if self.region is None:
            return None
        x0, y0, x1, y1 = self.region
        return self.magnitudes[:, y0:y1, x0:x1].mean((1, 2), dtype=np.float64)

    @property
    def sentences(self) -> list[str]:
        """All of it for a reader: the parameter that matters most comes first."""
        said = [
            "Mean change of the colours, black to white being 1, if the rate here lasted over a parameter's whole range:"
        ]
        width = max(map(len, self.space.names))
        for j in np.argsort(-self.of_view, kind="stable"):
            line = f"{self.space.names[j]:{width}}  {self.of_view[j]:.3f} in the view"
            if (region := self.of_region) is not None:
                line += f", {region[j]:.3f} in the region"
            said.append(line + self.doubt(int(j)))
        if self.agreements is None:
            said.append(f"Drawn by the {self.drawn_by} alone: no second prediction says how certain the maps are.")
        return said

    def doubt(self, number: int) -> str:
        """The end of a sentence about one map's agreement with that by another representation; "" without one."""
        if self.agreements is None or np.isnan(self.agreements[number]):
            return ""
        agreement = self.agreements[number]
        return f"; two predictions agree {agreement:.2f}" + ("" if agreement >= AGREE else ": the map is uncertain")

    def to_json(self) -> dict[str, Any]:
        """JSON values; maps by their means."""
        each = {}
        for j, name in enumerate(self.space.names):
            agreement = None if self.agreements is None else float(self.agreements[j])
            each[name] = {
                "view": float(self.of_view[j]),
                "region": None if self.of_region is None else float(self.of_region[j]),
                "agreement": None if agreement is None or np.isnan(agreement) else agreement,
            }
        own = {"parameters": dict(self.parameters), "region": self.region, "drawn_by": self.drawn_by}
        return own | {"changes": each}


def sensitivity(
    surrogate: Surrogate,
    parameters: Mapping[str, Any],
    camera: Camera,
    *,
    background: Sequence[float] | None = None,
    region: Box | None = None,
    step: float = STEP,
    compare: bool = True,
) -> Sensitivity:
    """The derivatives of the picture of `surrogate.at(parameters)` by the simulation's parameters, from 2 P + 1 pictures.

    They are central differences of `step`, a share of a parameter's range, and one-sided at a bound.  To `compare`, small maps by
    Gaussians and by the emulated field are drawn as well, where the surrogate holds both.

    Raises ValueError as `Surrogate.at` does, for parameters out of bounds, a region outside the picture, and a step that is not
    above 0 and at most a quarter.
    """
    space = surrogate.space
    if not 0.0 < step <= MOST_STEP:
        raise ValueError(f"step must be above 0 and at most {MOST_STEP} of a range, got {step!r}")
    if not len(space):
        raise ValueError("this surrogate has no parameters: nothing changes its pictures")
    member = surrogate.at(parameters, outside="allow")
    values = space.values({name: parameters[name] for name in space.names}, outside="allow")
    if outside := space.outside(values):
        raise ValueError(f"{next(iter(outside.values()))}: sensitivities are of places within the bounds")
    if region is not None:
        inside(region, camera)
    behind, chosen = background or WHITE, surrogate.drawn_by(parameters)
    steps = Steps.about(space, parameters, step)
    drawing = (GAUSSIANS, FIELD) if chosen == BOTH else (chosen,)
    maps = {name: steps.maps(surrogate.using(name).render, camera, behind) for name in drawing}
    agreements = None
    if compare and surrogate.field is not None and len(surrogate.gaussians):
        small = smaller(camera)
        draws: dict[str, Draw] = {
            GAUSSIANS: surrogate.using(GAUSSIANS).render,
            FIELD: SmallFields(surrogate.field).render,
        }
        by_gaussians, by_field = (
            _smaller(maps[name], small) if name in maps else steps.maps(draw, small, behind)
            for name, draw in draws.items()
        )
        agreements = correlations(by_gaussians, by_field)
    picture = member.render(camera)
    whole = np.stack([*maps.values()]).mean(0)
    return Sensitivity(space, dict(parameters), composite(picture, behind), whole, region, agreements, WORDS[chosen])


@dataclass(frozen=True, eq=False)
class Steps:
    """Parameters a step above and below a place, each alone.

    Attributes
    ----------
    rows : 2 P of them by name, first all above.
    widths : (P,) from below to above, in ranges.
    """

    rows: Sequence[Mapping[str, Any]]
    widths: NDArray[np.float64]

    __repr__ = one_line

    @classmethod
    def about(cls, space: ParameterSpace, parameters: Mapping[str, Any], step: float) -> Steps:
        """Those of a step, a share of the range, about `parameters`; they end at the bounds."""
        point = space.normalize([float(parameters[name]) for name in space.names])
        away = 2.0 * step * np.eye(len(space))
        above, below = np.clip(point + away, -1.0, 1.0), np.clip(point - away, -1.0, 1.0)
        tables = space.denormalize(np.concatenate([above, below])).tolist()
        rows = [{**parameters, **dict(zip(space.names, row, strict=True))} for row in tables]
        return cls(rows, np.diag(above - below) / 2.0)

    def maps(self, draw: Draw, camera: Camera, background: Sequence[float]) -> Array:
        """Derivatives (P, H, W, 3) of displayed pictures, times ranges."""
        pictures = np.stack([composite(picture, background) for picture in draw(self.rows, camera)])
        count = len(self.widths)
        widths = self.widths[:, None, None, None].astype(np.float32)
        return np.asarray((pictures[:count] - pictures[count:]) / widths)


def correlations(maps: Array, others: Array) -> NDArray[np.float64]:
    """Correlation of each of two times P maps (P, H, W, 3), over pixels and channels; NaN where both hardly change."""
    agreements = []
    for one, other in zip(maps.reshape(len(maps), -1), others.reshape(len(others), -1), strict=True):
        if max(np.abs(one).max(initial=0.0), np.abs(other).max(initial=0.0)) <= VISIBLE:
            agreements.append(np.nan)
        else:
            agreements.append(float(np.corrcoef(one, other)[0, 1]) if min(one.std(), other.std()) > 0.0 else 0.0)
    return np.array(agreements)


def _smaller(maps: Array, camera: Camera) -> Array:
    channels = [averaged(channel, camera.width, camera.height) for one in maps for channel in np.moveaxis(one, -1, 0)]
    return np.stack(channels).reshape(len(maps), 3, camera.height, camera.width).transpose(0, 2, 3, 1)
