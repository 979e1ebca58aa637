"""What training may be told: the `[training]` table of a scene, checked."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import math
import tomllib
import typing
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from catalogs.vocabulary.appearance import Appearance, VolumeRendering
from surrogate.gaussians import NAMES
from surrogate.splatting.rendering import Constants
from surrogate.splatting.samples import MOST_SAMPLES

ColorDegree = Literal["auto", 0, 1]
VisualizationKind = Literal["auto", "bilinear", "paper", "values"]


class Bound(NamedTuple):
    """What a value must be, in words and as a test."""

    words: str
    holds: Callable[[Any], bool]


ONE_OR_MORE = Bound("at least 1", lambda value: value >= 1)
TWO_OR_MORE = Bound("at least 2", lambda value: value >= 2)
MOST_FREQUENCIES = 8
FREQUENCIES = Bound(f"from 0 to {MOST_FREQUENCIES}", lambda value: 0 <= value <= MOST_FREQUENCIES)
SAMPLES = Bound(f"from 1 to {MOST_SAMPLES}", lambda value: 1 <= value <= MOST_SAMPLES)
NOT_NEGATIVE = Bound("at least 0", lambda value: value >= 0)
POSITIVE = Bound("positive", lambda value: value > 0)
FRACTION = Bound("in [0, 1]", lambda value: 0 <= value <= 1)
BETWEEN = Bound("between 0 and 1", lambda value: 0 < value < 1)
ATTRIBUTES = Bound(f"some of {[*NAMES, 'values']}", lambda value: set(value) <= {*NAMES, "values"})


def _setting(default: Any, bound: Bound | None = None, key: str = "", *, optional: bool = False) -> Any:
    """A field with its `key` in the table, its own name if empty; an `optional` one is not written at its default."""
    return dataclasses.field(default=default, metadata={"bound": bound, "key": key, "optional": optional})


def _require(bound: Bound | None, key: str, value: Any) -> None:
    if bound is not None and not bound.holds(value):
        raise ValueError(f"training.{key} must be {bound.words}, got {value!r}")


@dataclass(frozen=True)
class Start:
    """The Gaussians that stage 1 begins with.

    `initialization` places them: "in-situ" on the points that the hook sampled by opacity, "hull" in the visual hull of the member
    nearest to the parameters' mean, "sfm" on its structure from motion (the extra `[sfm]`), "random" uniformly in the box;
    "auto" takes in-situ points where the catalog has them, else "random".
    """

    initialization: Literal["auto", "in-situ", "hull", "sfm", "random"] = "auto"
    opacity: float = _setting(0.2, BETWEEN, "initial_opacity")
    scale: float = _setting(0.25, POSITIVE, "initial_scale")  # times the mean distance of as many, evenly in the box


@dataclass(frozen=True)
class Steps:
    """The length of each stage; stage 3 has as many for each variation of the appearance."""

    canonical: int = _setting(2_000, NOT_NEGATIVE, "canonical_steps")  # 0: learnt in stage 2, with the deformation
    deformation: int = _setting(10_000, NOT_NEGATIVE, "deformation_steps")
    visualization: int = _setting(10_000, NOT_NEGATIVE, "visualization_steps")


@dataclass(frozen=True)
class DeformationSize:
    """Sizes of a bilinear deformation."""

    latent: int = _setting(16, ONE_OR_MORE, "latent_size")  # numbers per Gaussian
    hidden: int = _setting(64, ONE_OR_MORE, "hidden_width")  # of the network that embeds the parameters


@dataclass(frozen=True)
class Designs:
    """What Gaussians carry, and which of `surrogate.deformation.READABLE` F_sim and F_vis are.

    Gaussians carry "colors", or the field's "values", to which transfer functions are applied; "auto" chooses values for unshaded
    volume renderings.  On the `scales` "auto" parameters that span a decade or more are learnt by their logarithms, on "given" ones
    as the catalog says.

    With "auto" F_vis is "values" for transfer functions, which it applies, and "bilinear" for all else, which it learns.
    """

    carried: Literal["auto", "colors", "values"] = _setting("auto", optional=True)
    scales: Literal["auto", "given"] = _setting("auto", key="parameter_scales", optional=True)
    simulation: Literal["bilinear", "paper"] = _setting("bilinear", key="deformation")
    held_still: tuple[str, ...] = _setting((), ATTRIBUTES, optional=True)  # what F_sim does not move
    visualization: VisualizationKind = _setting("auto", key="visualization_deformation")  # noqa: RUF009
    visualization_color_degree: ColorDegree = "auto"  # of the Gaussians that F_vis shows; "auto": as images decide
    value_bins: int = _setting(32, TWO_OR_MORE)  # of "values": for how many every Gaussian has weights
    latent_spread: float = _setting(0.25, POSITIVE)  # of "bilinear": standard deviation at the start
    parameter_frequencies: int = _setting(
        0, FREQUENCIES, optional=True
    )  # of "bilinear": with which F_sim may vary fast
    precision: Literal["float32", "bfloat16"] = _setting("float32", key="field_precision", optional=True)  # of "paper"

    def carry_values(self, shown: Appearance) -> bool:
        """Whether Gaussians that are to look like `shown` carry values of the field, rather than colours.

        Raises ValueError where values are asked for, but no transfer function alone says how these look.
        """
        fits = isinstance(shown, VolumeRendering) and not shown.shaded and self.simulation == "bilinear"
        if self.carried == "values" and not fits:
            raise ValueError(
                'training.carried = "values" needs an unshaded volume rendering and deformation = "bilinear", but '
                f'{shown.name} is {shown} and the deformation {self.simulation}: leave it out, or say "colors"'
            )
        return fits and self.carried != "colors"


@dataclass(frozen=True)
class Rates:
    """Adam's step sizes at the start of a stage, and what they are multiplied by: see `decay`."""

    means: float = _setting(3e-3, POSITIVE, "mean_rate")
    log_scales: float = _setting(6e-3, POSITIVE, "log_scale_rate")
    quats: float = _setting(3e-3, POSITIVE, "quat_rate")
    opacity_logits: float = _setting(6e-2, POSITIVE, "opacity_rate")
    colors: float = _setting(5e-3, POSITIVE, "color_rate")
    values: float = _setting(1e-3, POSITIVE, "field_value_rate", optional=True)
    latent: float = _setting(5e-2, POSITIVE, "latent_rate")
    embedding: float = _setting(1e-2, POSITIVE, "embedding_rate")
    value: float = _setting(2e-3, POSITIVE, "value_rate")
    canonical_factor: float = _setting(1.0, POSITIVE, "canonical_rate_factor")  # of the Gaussians in stage 2
    simulation_factor: float = _setting(0.1, NOT_NEGATIVE, "simulation_rate_factor")  # of F_sim in stage 3; 0: frozen
    # Of Gaussians that carry values, and of their F_sim, where they learn from more functions.
    refinement_factor: float = _setting(0.3, POSITIVE, "refinement_rate_factor", optional=True)
    final_factor: float = _setting(0.2, POSITIVE, "final_rate_factor")  # of all, reached exponentially in each stage
    cooldown: float = _setting(
        0.3, FRACTION, optional=True
    )  # of a stage: its last steps, in which all fall to 0 as well

    def decay(self, done: float) -> float:
        """What all rates are multiplied by once this part of a stage, from 0 to 1, is done.

        The exponential fall of 3D Gaussian splatting, times a linear one to 0 at the end (Hägele et al. 2024, "Scaling laws and
        compute-optimal training beyond fixed training durations"): steps that still wander leave noise in the last pictures.
        """
        falling = min(1.0, (1.0 - done) / self.cooldown) if self.cooldown else 1.0
        return self.final_factor**done * falling


@dataclass(frozen=True)
class OffsetUnits:
    """How far one unit of a deformation's output moves each attribute of a Gaussian."""

    means: float = _setting(0.05, POSITIVE, "mean_offset")
    log_scales: float = _setting(0.2, POSITIVE, "log_scale_offset")
    quats: float = _setting(0.1, POSITIVE, "quat_offset")
    opacity_logits: float = _setting(1.0, POSITIVE, "opacity_offset")
    colors: float = _setting(0.5, POSITIVE, "color_offset")
    values: float = _setting(0.1, POSITIVE, "field_value_offset", optional=True)


@dataclass(frozen=True)
class Loss:
    """Weights beside the mean absolute error, and how the images are drawn."""

    ssim_weight: float = _setting(0.2, FRACTION)  # of 1 - SSIM
    deformation_penalty: float = _setting(0.0, NOT_NEGATIVE)  # of GS-Surrogate's L_deform: mean squared offsets
    values: float = _setting(0.005, NOT_NEGATIVE, "field_value_weight", optional=True)  # of `training.value_loss`
    hard_example_power: float = _setting(0.0, NOT_NEGATIVE)  # of errors, which images are drawn by; GS-Surrogate: 1.5


@dataclass(frozen=True)
class Relocation:
    """When a Gaussian is dead, by the decayed maximum of its deformed opacity, and where it goes."""

    interval: int = _setting(100, NOT_NEGATIVE, "relocation_interval")  # steps; 0: never
    target: Literal["opacity", "gradient"] = _setting("opacity", key="relocation_target")  # who attracts the dead
    gradient_threshold: float = _setting(1e-4, NOT_NEGATIVE)  # on the screen, which those who attract exceed
    stop: float = _setting(0.7, FRACTION, "relocation_stop")  # of a stage; later no Gaussian is relocated
    dead_opacity: float = _setting(0.01, BETWEEN)
    peak_decay: float = _setting(0.995, FRACTION)  # per step


@dataclass(frozen=True)
class Splatting:
    """Those of the rasterizer's `surrogate.splatting.Constants` that can be set, the backend, and samples along a pixel's side."""

    alpha_floor: float = _setting(Constants.alpha_floor, FRACTION)
    alpha_cap: float = Constants.alpha_cap
    dilation: float = _setting(Constants.dilation, NOT_NEGATIVE)  # added to each projected variance, in pixels squared
    backend: str = "auto"
    samples: int = _setting(1, SAMPLES, optional=True)
    surface_samples: int = _setting(2, SAMPLES, optional=True)  # where the light on isosurfaces is known

    def __post_init__(self) -> None:
        above = Bound("above alpha_floor and below 1", lambda value: self.alpha_floor < value < 1)
        _require(above, "alpha_cap", self.alpha_cap)


@dataclass(frozen=True)
class Compression:
    """Whether training ends by removing attributes, modes, Gaussians and bits that validation images do not need."""

    enabled: bool = _setting(True, key="fit_to_need")
    tolerance: float = _setting(0.05, NOT_NEGATIVE, "need_tolerance")  # dB that each choice may cost
    recovery_fraction: float = _setting(0.02, FRACTION)  # of all steps, for which a model is fine-tuned after it


@dataclass(frozen=True)
class Validation:
    """Steps between validations, and the number of images that each looks at; 0 for none."""

    interval: int = _setting(500, NOT_NEGATIVE, "validation_interval")
    images: int = _setting(16, NOT_NEGATIVE, "validation_images")


@dataclass(frozen=True, init=False, repr=False)
class TrainingSettings:
    """Every choice of a training run; two runs with equal settings on equal catalogs end bit for bit alike.

    They are made by the keys of the table and read as records: `TrainingSettings(mean_rate=1e-3).rates.means`.
    Lengths (`mean_rate`, `mean_offset`) are in units of half the longest side of the catalog's box.

    Attributes
    ----------
    seed : seeds everything that is drawn at random.
    appearance : which of the catalog's appearances is learnt; "" means the first.
    gaussians : how many Gaussians, constant through training (dead ones are relocated).
    visualization_gaussians : how many isosurfaces have, of their own; 0 for as many as the base.
    color_degree : 0 for one colour per Gaussian; 1 adds a linear dependence on the viewing direction (shading); "auto" lets
        validation images decide.
    simulation_size, visualization_size : of F_sim and of F_vis, whose keys begin with `visualization_`.
    device : where training computes, "auto" being a GPU where torch and gsplat can use one, else "cpu".
    checkpoint_seconds : time between checkpoints.
    batch : pictures of a step; rates are multiplied by its square root.
    """

    seed: int = _setting(0, NOT_NEGATIVE)
    appearance: str = ""
    gaussians: int = _setting(10_000, ONE_OR_MORE)
    visualization_gaussians: int = _setting(0, NOT_NEGATIVE, optional=True)
    start: Start = Start()
    color_degree: ColorDegree = "auto"
    steps: Steps = Steps()
    simulation_size: DeformationSize = DeformationSize()
    visualization_size: DeformationSize = _setting(DeformationSize(), key="visualization_")  # noqa: RUF009
    designs: Designs = Designs()
    rates: Rates = Rates()
    units: OffsetUnits = OffsetUnits()
    loss: Loss = Loss()
    relocation: Relocation = Relocation()
    splatting: Splatting = Splatting()
    device: Literal["auto", "cpu", "cuda"] = "auto"
    compression: Compression = Compression()
    validation: Validation = Validation()
    checkpoint_seconds: float = _setting(30.0, POSITIVE)
    batch: int = _setting(1, ONE_OR_MORE, optional=True)

    def __init__(self, /, **values: Any) -> None:
        """Settings by the keys of the `[training]` table; those that are absent keep their defaults.

        Raises ValueError naming an unknown key, a value of the wrong type or one out of bounds.
        """
        if unknown := sorted(set(values) - set(_keys())):
            raise ValueError(f"training: unknown keys {unknown}{_meant(unknown)}; known are {sorted(_keys())}")
        given: dict[str, dict[str, Any]] = {}
        for key, value in values.items():
            record, field, kind = _keys()[key]
            given.setdefault(record, {})[field.name] = _typed(key, value, kind)
            _require(field.metadata.get("bound"), key, given[record][field.name])
        own = given.pop("", {})
        own |= {record: dataclasses.replace(getattr(self, record), **changes) for record, changes in given.items()}
        for name, value in own.items():
            object.__setattr__(self, name, value)

    @property
    def count_on_surfaces(self) -> int:
        """How many Gaussians isosurfaces have."""
        return self.visualization_gaussians or self.gaussians

    def changed(self, /, **values: Any) -> TrainingSettings:
        """The same with other values of some keys."""
        return TrainingSettings(**self.to_json() | values)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values by key, which make the same settings again."""
        values = [(key, entry.value(self), entry.field) for key, entry in _keys().items()]
        return {key: v for key, v, field in values if v != field.default or not field.metadata.get("optional")}

    def __repr__(self) -> str:
        other = [f"{key}={value!r}" for key, value in self.to_json().items() if value != _keys()[key].field.default]
        return f"TrainingSettings({', '.join(other)})"


def values_of_words(words: Iterable[str]) -> dict[str, Any]:
    """The values by key that words such as "gaussians=20000" or "held_still=quats,colors" say, each of its key's type.

    Raises ValueError for a word that is none such, a key that is not known or stands twice, and a value of another type.
    """
    found: dict[str, Any] = {}
    for word in words:
        key, sign, text = word.partition("=")
        if not sign or not key:
            raise ValueError(f"settings are KEY=VALUE, such as gaussians=20000, got {word!r}")
        if key in found:
            raise ValueError(f"training.{key} is given twice: {found[key]!r} and {text!r}")
        found[key] = _of_text(text, _keys()[key].kind) if key in _keys() else text
    TrainingSettings(**found)  # says what is wrong
    return found


def _of_text(text: str, kind: Any) -> Any:
    """What a text says as a value of a key's type; the text where it says none."""
    if kind == tuple[str, ...]:
        return tuple(filter(None, text.split(",")))
    if kind is str:
        return text
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _meant(unknown: Sequence[str]) -> str:
    """The known keys that unknown ones look like, as a question; "" where they look like none."""
    found = [match for key in unknown for match in difflib.get_close_matches(key, _keys(), n=1)]
    return f" (did you mean {' and '.join(found)}?)" if found else ""


class _Key(NamedTuple):
    """Where a key of the table leads: to a record, "" for the settings themselves, a field of it, and that one's type."""

    record: str
    field: dataclasses.Field[Any]
    kind: Any

    def value(self, settings: TrainingSettings) -> Any:
        """The value in some settings."""
        return getattr(getattr(settings, self.record) if self.record else settings, self.field.name)


@functools.cache
def _keys() -> dict[str, _Key]:
    """All keys of the table, in order."""
    found: dict[str, _Key] = {}

    def add(record: type, name: str, prefix: str) -> None:
        kinds = typing.get_type_hints(record)
        for field in dataclasses.fields(record):
            key = field.metadata.get("key", "")
            if dataclasses.is_dataclass(field.default):
                add(kinds[field.name], field.name, key)
            else:
                found[prefix + (key or field.name)] = _Key(name, field, kinds[field.name])

    add(TrainingSettings, "", "")
    return found


def _typed(name: str, value: Any, kind: Any) -> Any:
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if kind == tuple[str, ...]:
        if not isinstance(value, list | tuple) or not all(isinstance(part, str) for part in value):
            raise ValueError(f"training.{name} must be a list of strings, got {value!r}")
        return tuple(value)
    options = typing.get_args(kind)
    if options:
        if value not in options:
            raise ValueError(f"training.{name} must be one of {list(options)}, got {value!r}")
    elif not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"training.{name} must be of type {kind.__name__}, got {value!r}")
    elif kind is float and not math.isfinite(value):
        raise ValueError(f"training.{name} must be finite, got {value!r}")
    return value
