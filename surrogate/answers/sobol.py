"""Global sensitivity, or what matters over the whole box of parameters: first and total Sobol indices of pictures and numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import field_of
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.words import joined_names, one_line
from surrogate.answers.next_runs import mean_lengths
from surrogate.answers.sensitivity import Box, Draw
from surrogate.answers.small_fields import SmallFields
from surrogate.answers.targets import inside
from surrogate.emulation.exports import xarray_package
from surrogate.emulation.measures import MAXIMUM, MEAN, MINIMUM, NUMBERS, SHARE, box_numbers
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.model import Surrogate
from surrogate.model.representation import FIELD, GAUSSIANS, VIEW, WORDS
from surrogate.randomness import sobol_points

if TYPE_CHECKING:
    import xarray

SAMPLES = 512
SIDE = 32  # pixels along the longer side: means and variances need no more
BATCH = 32
RESAMPLES, SEED = 1000, 0
NORMAL = 1.96  # standard deviations, of which 95 % lie between minus and plus
COLOUR, OPACITY, PICTURE = "colour", "opacity", "picture"
OF_PICTURES, OF_FIELDS = (PICTURE, COLOUR, OPACITY), (MEAN, MINIMUM, MAXIMUM, SHARE)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Response:
    """A quantity that depends on the parameters.

    Attributes
    ----------
    words : such as "mean colour of the region".
    values : (B, K) at parameters (B, P), in their units; the variances of K values are summed.
    source : the words for the representation that it comes from; "" where it is none of a surrogate.
    lengths : (P,) the emulated field's length scales, in ranges: short where the field changes fast; None without a field.
    """

    words: str
    values: Callable[[Array], NDArray[Any]]
    source: str = ""
    lengths: Array | None = None

    __repr__ = one_line


@dataclass(frozen=True, eq=False)
class Distribution:
    """Independent distributions of P parameters.

    Attributes
    ----------
    words : for a reader.
    quantiles : normalized parameters (B, P) at shares (B, P) from 0 to 1.
    """

    words: str
    quantiles: Callable[[Array], Array]

    __repr__ = one_line

    @classmethod
    def even(cls, space: ParameterSpace) -> Distribution:
        """Even within the bounds, each parameter on its own scale."""
        logarithmic = [p.name for p in space.parameters if p.scale == "log"]
        scales = f", {joined_names(logarithmic)} on a logarithmic scale" if logarithmic else ""
        return cls(f"even within the bounds{scales}", lambda shares: 2.0 * shares - 1.0)

    @classmethod
    def of_members(cls, space: ParameterSpace, catalog: Catalog) -> Distribution:
        """Each parameter as the members have it, between their values and cut to the bounds; raises ValueError without members."""
        table = [space.values(member.parameters, outside="allow") for member in catalog.members]
        if not table:
            raise ValueError(f"{catalog.path} has no members, so nobody knows how parameters are distributed")
        values = np.sort(np.clip(space.normalize(table), -1.0, 1.0), axis=0)  # [M, P]
        places = np.linspace(0.0, 1.0, len(values))

        def quantiles(shares: Array) -> Array:
            columns = [np.interp(share, places, own) for share, own in zip(shares.T, values.T, strict=True)]
            return np.stack(columns, axis=1)

        return cls(f"each independently, as the {len(values)} members are distributed", quantiles)


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Shares of a response's variance.

    Attributes
    ----------
    space : P parameters.
    response : whose variance it is.
    distribution : of the parameters, in words.
    samples : the base sample, N; P + 2 times as many points were drawn.
    first : (P,) of a parameter alone.
    total : (P,) with all that it does together with others.
    first_half, total_half : (P,) half widths of 95 % intervals, by bootstrap.
    deviation : of the response, in its unit: the root of the summed variances.
    """

    space: ParameterSpace
    response: Response
    distribution: str
    samples: int
    first: Array
    total: Array
    first_half: Array
    total_half: Array
    deviation: float

    def __repr__(self) -> str:
        ranked = np.argsort(-self.total, kind="stable")
        each = ", ".join(f"{self.space.names[j]} {self.total[j]:.2f} ({self.first[j]:.2f} alone)" for j in ranked)
        return f"<SobolIndices of the {self.response.words}: {each}>"

    def to_xarray(self) -> xarray.Dataset:
        """`first`, `total` and their half widths over parameters; raises ModuleNotFoundError without xarray."""
        named = {name: ("parameter", getattr(self, name)) for name in ("first", "total", "first_half", "total_half")}
        about = {"response": self.response.words, "distribution": self.distribution, "samples": self.samples}
        return xarray_package().Dataset(named, {"parameter": list(self.space.names)}, about)

    @property
    def sentences(self) -> list[str]:
        """All of it for a reader: the parameter that matters most comes first."""
        if not self.deviation > 0.0:
            return [f"No parameter changes the {self.response.words}."]
        source, lengths = self.response.source, self.response.lengths
        by = f", by the {source}" if source else ""
        said = [
            f"Shares of the variance of the {self.response.words}{by}.",
            f"Parameters: {self.distribution}; {self.samples * (len(self.space) + 2):,} points.",
        ]
        width = max(map(len, self.space.names))
        for j in np.argsort(-self.total, kind="stable"):
            line = (
                f"{self.space.names[j]:{width}}  {self.total[j]:.2f} ± {self.total_half[j]:.2f}, "
                f"{self.first[j]:.2f} ± {self.first_half[j]:.2f} of it alone"
            )
            if lengths is not None:
                line += f"; the field's length scale {lengths[j]:.2g} ranges"
            said.append(line)
        return said

    def to_json(self) -> dict[str, Any]:
        """JSON values."""
        lengths = self.response.lengths
        each = {
            name: {
                "first": float(self.first[j]),
                "first_half": float(self.first_half[j]),
                "total": float(self.total[j]),
                "total_half": float(self.total_half[j]),
                "length": None if lengths is None else float(lengths[j]),
            }
            for j, name in enumerate(self.space.names)
        }
        own = {"response": self.response.words, "source": self.response.source, "distribution": self.distribution}
        return own | {"samples": self.samples, "deviation": self.deviation, "indices": each}


def sobol_indices(
    space: ParameterSpace,
    response: Response,
    distribution: Distribution | None = None,
    *,
    samples: int = SAMPLES,
    seed: int = SEED,
) -> SobolIndices:
    """First and total indices of a response of the parameters, which are even within their bounds unless a distribution is given.

    Estimators are SALib's: Saltelli et al. 2010 for the first, Jansen 1999 for the total index, on scrambled Sobol points.
    Written here since SALib takes single numbers: the variances of a picture's pixels are summed before shares are formed.
    Raises ValueError unless `samples` is a power of two from 8 to 65,536, and for a space without parameters.
    """
    count = len(space)
    if not count:
        raise ValueError("the space has no parameters: nothing can matter")
    if not (8 <= samples <= 65_536 and samples & (samples - 1) == 0):
        raise ValueError(f"samples must be a power of two from 8 to 65,536, got {samples}")
    distribution = distribution or Distribution.even(space)
    points = space.denormalize(distribution.quantiles(_design(samples, count, seed)))
    pieces = [response.values(points[i : i + BATCH]) for i in range(0, len(points), BATCH)]
    alone, total, variance = _terms(np.concatenate(pieces).reshape(samples, count + 2, -1))
    means = variance.mean() or 1.0
    weights = np.random.default_rng(seed).multinomial(samples, np.full(samples, 1.0 / samples), RESAMPLES)  # [R, N]
    resampled = weights @ variance if variance.any() else np.full(RESAMPLES, samples)
    alone_half, total_half = (NORMAL * ((weights @ each) / resampled[:, None]).std(0) for each in (alone, total))
    first, whole = alone.mean(0) / means, total.mean(0) / means
    deviation = float(variance.mean() ** 0.5)
    return SobolIndices(space, response, distribution.words, samples, first, whole, alone_half, total_half, deviation)


def _design(samples: int, count: int, seed: int) -> Array:
    """Shares (N (P + 2), P): of each sample a first point, a second, and the first with each coordinate of the second."""
    first, second = np.split((sobol_points(samples, 2 * count, seed) + 1.0) / 2.0, 2, axis=1)
    mixed = np.repeat(first[:, None], count, axis=1)  # [N, P, P]
    mixed[:, range(count), range(count)] = second
    return np.concatenate([first[:, None], second[:, None], mixed], axis=1).reshape(-1, count)


def _terms(values: NDArray[Any]) -> tuple[Array, Array, Array]:
    """Each sample's part in the first (N, P) and total (N, P) indices and the variance (N,), of values (N, P + 2, K)."""
    first, second = (values[:, i].astype(np.float64) for i in (0, 1))
    middle = 0.5 * (first.mean(0) + second.mean(0))
    first, second = first - middle, second - middle
    away = [values[:, j] - middle - first for j in range(2, values.shape[1])]  # P of [N, K]
    alone = np.stack([(second * each).sum(-1) for each in away], axis=1)
    total = np.stack([0.5 * (each**2).sum(-1) for each in away], axis=1)
    return alone, total, 0.5 * (first**2 + second**2).sum(-1)


def picture_response(
    surrogate: Surrogate,
    camera: Camera,
    of: str = PICTURE,
    *,
    region: Box | None = None,
    background: Sequence[float] | None = None,
) -> Response:
    """All pixels of a small picture, their mean colour or their mean opacity, by the representation that draws views.

    Instead of the mean image the emulated field is drawn, on a coarse lattice.  Raises ValueError for a region outside the picture.
    """
    if of not in OF_PICTURES:
        raise ValueError(f"of must be one of {joined_names(OF_PICTURES)}, got {of!r}")
    if region is not None:
        inside(region, camera)
        x0, y0, x1, y1 = region
        camera = replace(camera, cx=camera.cx - x0, cy=camera.cy - y0, width=x1 - x0, height=y1 - y0)
    share = min(1.0, SIDE / max(camera.width, camera.height))
    small = camera.resized(*(max(1, round(n * share)) for n in (camera.width, camera.height)))
    by = GAUSSIANS if surrogate.field is None or surrogate.representation(VIEW) == GAUSSIANS else FIELD
    draw: Draw = surrogate.using(by).render
    if surrogate.field is not None and by == FIELD:
        draw = SmallFields(surrogate.field).render

    def values(points: Array) -> NDArray[Any]:
        rows = [dict(zip(surrogate.space.names, point, strict=True)) for point in points.tolist()]
        images = draw(rows, small)
        if of == OPACITY:
            return images[..., 3].mean((1, 2))[:, None]
        displayed = np.stack([composite(image, background or WHITE) for image in images])
        return displayed.mean((1, 2)) if of == COLOUR else displayed.reshape(len(points), -1)

    words = {PICTURE: "pixels", COLOUR: "mean colour", OPACITY: "mean opacity"}[of]
    place = "of the picture" if region is None else "in the region {}, {} to {}, {}".format(*region)
    return Response(f"{words} {place}", values, WORDS[by], _lengths(surrogate))


def field_response(surrogate: Surrogate, of: str = MEAN, level: float | None = None) -> Response:
    """A number of the emulated field that the base appearance shows, on a coarse lattice: its mean, minimum, maximum, share_above.

    Raises ValueError without an emulated field, and for a share without a level.
    """
    if surrogate.field is None:
        raise ValueError(
            "this surrogate has no emulated field, so no numbers: train it on a catalog with coarse fields"
        )
    if of not in OF_FIELDS or (of == SHARE) != (level is not None):
        raise ValueError(f"of must be one of {joined_names(OF_FIELDS)}, and {SHARE} takes a level, got {of!r}, {level}")
    fields, number, above = SmallFields(surrogate.field), NUMBERS.index(of), np.nan if level is None else level

    def values(points: Array) -> NDArray[Any]:
        rows = [dict(zip(surrogate.space.names, point, strict=True)) for point in points.tolist()]
        return np.stack([box_numbers(fields.values(row), above)[number : number + 1] for row in rows])

    label = surrogate.field.labels((surrogate.field.appearances[0].name,))[0]
    words = f"{of} of {label}" if level is None else f"share of {label} above {level:g}"
    return Response(words, values, WORDS[FIELD], _lengths(surrogate))


def response_of(
    surrogate: Surrogate,
    camera: Camera,
    of: str = PICTURE,
    *,
    region: Box | None = None,
    level: float | None = None,
    background: Sequence[float] | None = None,
) -> Response:
    """That of pictures or of the field, by its name; raises ValueError as these do, and for what a field has no use for."""
    if of in OF_PICTURES and level is None:
        return picture_response(surrogate, camera, of, region=region, background=background)
    if region is not None or of in OF_PICTURES:
        raise ValueError(f"a region is of pictures, and a level of {SHARE}: {of} takes no such thing")
    return field_response(surrogate, of, level)


def _lengths(surrogate: Surrogate) -> Array | None:
    if surrogate.field is None:
        return None
    return mean_lengths(surrogate.field.emulators[field_of(surrogate.field.appearances[0])])
