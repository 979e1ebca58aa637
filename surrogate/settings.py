"""Validated training settings: the `[training]` table of a scene."""

from __future__ import annotations

import dataclasses
import difflib
import math
import tomllib
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from catalogs.vocabulary.appearance import Appearance, VolumeRendering
from catalogs.vocabulary.words import joined_names

ColorDegree = Literal["auto", 0, 1]
MOST_FREQUENCIES = 8
# Keys that a record leaves out at their defaults: fingerprints of models made before these keys existed stay the same.
OMITTED_AT_DEFAULT = frozenset(
    {
        "visualization_gaussians",
        "carried",
        "parameter_frequencies",
        "field_value_weight",
        "samples",
        "surface_samples",
        "batch",
        "early_downsampling",
    }
)
# Former keys, all constants today: records still list them, and fingerprints still cover them.
FORMER: Mapping[str, Any] = {
    "initial_opacity": 0.2,
    "initial_scale": 0.25,
    "visualization_latent_size": 16,
    "visualization_hidden_width": 64,
    "deformation": "bilinear",
    "visualization_deformation": "auto",
    "value_bins": 32,
    "latent_spread": 0.25,
    "mean_rate": 3e-3,
    "log_scale_rate": 6e-3,
    "quat_rate": 3e-3,
    "opacity_rate": 6e-2,
    "color_rate": 5e-3,
    "value_rate": 2e-3,
    "canonical_rate_factor": 1.0,
    "simulation_rate_factor": 0.1,
    "final_rate_factor": 0.2,
    "mean_offset": 0.05,
    "log_scale_offset": 0.2,
    "quat_offset": 0.1,
    "opacity_offset": 1.0,
    "color_offset": 0.5,
    "ssim_weight": 0.2,
    "deformation_penalty": 0.0,
    "hard_example_power": 0.0,
    "relocation_target": "opacity",
    "gradient_threshold": 1e-4,
    "relocation_stop": 0.7,
    "dead_opacity": 0.01,
    "peak_decay": 0.995,
    "alpha_floor": 1 / 255,
    "alpha_cap": 0.999,
    "dilation": 0.003,
    "recovery_fraction": 0.02,
}
# Former keys that records list only at other values than the constants of today.
RARE = frozenset(
    {
        "cooldown",
        "field_precision",
        "field_value_offset",
        "field_value_rate",
        "held_still",
        "parameter_scales",
        "refinement_rate_factor",
    }
)


class Bound(NamedTuple):
    """A condition on a value, in words and as a test."""

    words: str
    holds: Callable[[Any], bool]


ONE_OR_MORE = Bound("at least 1", lambda value: value >= 1)
NOT_NEGATIVE = Bound("at least 0", lambda value: value >= 0)
POSITIVE = Bound("positive", lambda value: value > 0)
MOST_DOWNSAMPLING = 8
MOST_SAMPLES = 4  # of a pixel, along a side; memory grows with its square
SAMPLES = Bound(f"from 1 to {MOST_SAMPLES}", lambda value: 1 <= value <= MOST_SAMPLES)
BOUNDS: Mapping[str, Bound] = {
    "seed": NOT_NEGATIVE,
    "gaussians": ONE_OR_MORE,
    "visualization_gaussians": NOT_NEGATIVE,
    "canonical_steps": NOT_NEGATIVE,
    "deformation_steps": NOT_NEGATIVE,
    "visualization_steps": NOT_NEGATIVE,
    "latent_size": ONE_OR_MORE,
    "hidden_width": ONE_OR_MORE,
    "parameter_frequencies": Bound(f"from 0 to {MOST_FREQUENCIES}", lambda value: 0 <= value <= MOST_FREQUENCIES),
    "latent_rate": POSITIVE,
    "embedding_rate": POSITIVE,
    "field_value_weight": NOT_NEGATIVE,
    "relocation_interval": NOT_NEGATIVE,
    "samples": SAMPLES,
    "surface_samples": SAMPLES,
    "need_tolerance": NOT_NEGATIVE,
    "validation_interval": NOT_NEGATIVE,
    "validation_images": NOT_NEGATIVE,
    "checkpoint_seconds": POSITIVE,
    "batch": ONE_OR_MORE,
    "early_downsampling": Bound("1, 2, 4 or 8", lambda value: value in (1, 2, 4, MOST_DOWNSAMPLING)),
}


@dataclass(frozen=True, repr=False, kw_only=True)
class TrainingSettings:
    """All choices of a training run; two runs with equal settings on equal catalogs end bit for bit alike.

    Raises ValueError naming a value of the wrong type or out of bounds.

    Attributes
    ----------
    seed : of all random numbers.
    appearance : the catalog's appearance that is learnt; "" means the first.
    gaussians : number of Gaussians, constant through training (dead ones are relocated).
    visualization_gaussians : number of the Gaussians that isosurfaces have of their own; 0 for as many as the base.
    initialization : start of the Gaussians.  They start in the box at "random", on points that the hook sampled by opacity
        ("in-situ"), or on structure from motion ("sfm", with the extra `[sfm]`).  The default "auto" takes in-situ points where the
        catalog has them, else random ones.
    color_degree, visualization_color_degree : 0 for one colour per Gaussian; 1 adds a linear dependence on the viewing direction
        (shading); "auto" lets validation images decide.  The second is for the Gaussians of a variation.
    canonical_steps, deformation_steps, visualization_steps : length of each stage; the last for each variation of the appearance.
        Without canonical steps the canonical Gaussians are learnt in stage 2.
    latent_size, hidden_width : numbers per Gaussian, and hidden units, of a bilinear deformation.
    parameter_frequencies : octaves of sines of each parameter that the simulation deformation also depends on.
    carried : per-Gaussian "colors", or field "values" to which transfer functions are applied; "auto" chooses values for unshaded
        volume renderings.
    latent_rate, embedding_rate : Adam's step sizes for a bilinear deformation's latents and networks.
    field_value_weight : of the loss of field values at points beside that of images; see `surrogate.training.value_loss`.
    relocation_interval : steps between relocations of dead Gaussians; 0 for none.
    backend, samples, surface_samples : of the rasterizer; samples along each side of a pixel, the second for lit isosurfaces.
    device : "cpu", "cuda", or "auto" for a GPU where torch and gsplat can use one.
    fit_to_need, need_tolerance : whether training ends by removing attributes, modes, Gaussians and bits that validation images do
        not need, and the loss in dB that each choice may cause.
    validation_interval, validation_images : steps between validations, and images of each; 0 for none.
    checkpoint_seconds : time between checkpoints.
    batch : images of a step; rates are multiplied by its square root.
    early_downsampling : side of the blocks of pixels that are averaged to one: 1, 2, 4 or 8.  It falls to 1 in the last 30 % of a
        stage.  Images whose sides it does not divide stay whole.

    Examples
    --------
    >>> from surrogate import TrainingSettings
    >>> settings = TrainingSettings(gaussians=2000, canonical_steps=500, deformation_steps=2000)
    >>> settings.seed, settings.latent_size
    (0, 16)
    """

    seed: int = 0
    appearance: str = ""
    gaussians: int = 10_000
    visualization_gaussians: int = 0
    initialization: Literal["auto", "in-situ", "sfm", "random"] = "auto"
    color_degree: ColorDegree = "auto"
    visualization_color_degree: ColorDegree = "auto"
    canonical_steps: int = 2_000
    deformation_steps: int = 10_000
    visualization_steps: int = 10_000
    latent_size: int = 16
    hidden_width: int = 64
    parameter_frequencies: int = 0
    carried: Literal["auto", "colors", "values"] = "auto"
    latent_rate: float = 5e-2
    embedding_rate: float = 1e-2
    field_value_weight: float = 0.005
    relocation_interval: int = 100
    backend: str = "auto"
    samples: int = 1
    surface_samples: int = 2
    device: Literal["auto", "cpu", "cuda"] = "auto"
    fit_to_need: bool = True
    need_tolerance: float = 0.05
    validation_interval: int = 500
    validation_images: int = 16
    checkpoint_seconds: float = 30.0
    batch: int = 1
    early_downsampling: int = 1

    def __post_init__(self) -> None:
        for name, kind in _TYPES.items():
            value = _typed(name, getattr(self, name), kind)
            bound = BOUNDS.get(name)
            if bound is not None and not bound.holds(value):
                raise ValueError(f"training.{name} must be {bound.words}, got {value!r}")
            object.__setattr__(self, name, value)

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> TrainingSettings:
        """Settings of a `[training]` table; absent keys keep their defaults.

        Raises ValueError naming an unknown key, a value of the wrong type or one out of bounds.
        """
        if former := sorted(set(table) & {*FORMER, *RARE}):
            raise ValueError(
                f"training: leave out {', '.join(former)}, which this version does not have any more (it is a constant now)"
            )
        if unknown := sorted(set(table) - set(_TYPES)):
            raise ValueError(
                f"training: unknown keys {joined_names(unknown)}{_meant(unknown)}; known are {joined_names(sorted(_TYPES))}"
            )
        return cls(**table)

    @classmethod
    def from_record(cls, values: Mapping[str, Any]) -> TrainingSettings:
        """Settings of a stored run without former keys; raises ValueError as `from_table` does.

        A run with another value of a former key has another fingerprint, by which training refuses to resume it.
        """
        return cls.from_table({key: value for key, value in values.items() if key not in FORMER and key not in RARE})

    @property
    def count_on_surfaces(self) -> int:
        """The number of Gaussians on isosurfaces."""
        return self.visualization_gaussians or self.gaussians

    def carry_values(self, appearance: Appearance) -> bool:
        """True where Gaussians that are to look like an appearance carry values of the field, rather than colours.

        Raises ValueError where values are asked for, but no transfer function alone determines the appearance.
        """
        fits = isinstance(appearance, VolumeRendering) and not appearance.shaded
        if self.carried == "values" and not fits:
            raise ValueError(
                f'training.carried = "values" needs an unshaded volume rendering, but {appearance.name} is {appearance}: '
                'leave it out, or say "colors"'
            )
        return fits and self.carried != "colors"

    def changed(self, /, **values: Any) -> TrainingSettings:
        """The same with other values of some keys; raises ValueError as `from_table` does."""
        return TrainingSettings.from_table(self.to_json() | values)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values by key, from which `from_table` makes the same settings."""
        values = {name: getattr(self, name) for name in _TYPES}
        return {k: v for k, v in values.items() if k not in OMITTED_AT_DEFAULT or v != getattr(type(self), k)}

    def __repr__(self) -> str:
        values = ((name, getattr(self, name)) for name in _TYPES)
        other = [f"{name}={value!r}" for name, value in values if value != getattr(type(self), name)]
        return f"TrainingSettings({', '.join(other)})"


def values_of_words(words: Iterable[str]) -> dict[str, Any]:
    """The values by key in words such as "gaussians=20000" or "carried=colors", each of its key's type.

    Raises ValueError for any other word, an unknown key, a key that is given twice, and a value of another type.
    """
    values: dict[str, Any] = {}
    for word in words:
        key, sign, text = word.partition("=")
        if not sign or not key:
            raise ValueError(f"settings are KEY=VALUE, such as gaussians=20000, got {word!r}")
        if key in values:
            raise ValueError(f"training.{key} is given twice: {values[key]!r} and {text!r}")
        values[key] = text if _TYPES.get(key, str) is str else _of_text(text)
    TrainingSettings.from_table(values)  # raises for what is wrong
    return values


def _of_text(text: str) -> Any:
    """A number or truth value that a text spells as TOML does, else the text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _meant(unknown: Iterable[str]) -> str:
    """A question about the keys that unknown ones resemble; "" for none."""
    matches = [match for key in unknown for match in difflib.get_close_matches(key, _TYPES, n=1)]
    return f" (did you mean {' and '.join(matches)}?)" if matches else ""


def _typed(name: str, value: Any, kind: Any) -> Any:
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    options = typing.get_args(kind)
    if options:
        if value not in options:
            raise ValueError(f"training.{name} must be one of {joined_names(options)}, got {value!r}")
    elif not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"training.{name} must be of type {kind.__name__}, got {value!r}")
    elif kind is float and not math.isfinite(value):
        raise ValueError(f"training.{name} must be finite, got {value!r}")
    return value


_TYPES = {
    each.name: typing.get_type_hints(TrainingSettings)[each.name] for each in dataclasses.fields(TrainingSettings)
}
