"""What training may be told: the `[training]` table of a scene, checked."""

from __future__ import annotations

import math
import typing
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal

from surrogate.gaussians import NAMES
from surrogate.splatting.constants import Constants

ColorDegree = Literal["auto", 0, 1]
Device = Literal["auto", "cpu", "cuda"]
Initialization = Literal["auto", "in-situ", "hull", "sfm", "random"]
DeformationKind = Literal["bilinear", "paper"]
RelocationTarget = Literal["opacity", "gradient"]
VisualizationKind = Literal["auto", "bilinear", "paper", "values"]
FieldPrecision = Literal["float32", "bfloat16"]


@dataclass(frozen=True)
class TrainingSettings:
    """Every choice of a training run; two runs with equal settings on equal catalogs end bit for bit alike.

    Lengths (`mean_rate`, `mean_offset`) are in units of half the longest side of the catalog's box.  Rates are
    Adam's step sizes at the start of a stage.

    Attributes
    ----------
    seed : seeds everything that is drawn at random.
    appearance : which of the catalog's appearances is learnt; "" means the first.
    gaussians : how many Gaussians, constant through training (dead ones are relocated).
    initialization : "in-situ" places them on the points that the hook sampled by opacity, "hull" in the visual hull of the
        member nearest to the parameters' mean, "sfm" on its structure from motion (the extra `[sfm]`), "random" uniformly in
        the box; "auto" takes in-situ points where the catalog has them, else "random".
    initial_opacity, initial_scale : opacity of a fresh Gaussian, and its standard deviation in units of the mean
        distance between Gaussians spread evenly through the box.
    color_degree : 0 for one colour per Gaussian; 1 adds a linear dependence on the viewing direction (shading); "auto" lets
        held-out views of one member decide.
    canonical_steps, deformation_steps : length of stage 1 (one set of Gaussians for all members; 0: both are learnt jointly
        from the start) and of stage 2 (the same, deformed by the simulation parameters).
    latent_size, hidden_width : the bilinear deformation's latent vector per Gaussian, and the width of the network
        that embeds the parameters.
    latent_spread : standard deviation of the latent vectors at the start of stage 2.
    deformation : the design of F_sim, of `surrogate.deformation.KINDS`.
    field_precision : what the "paper" design computes in per Gaussian; "bfloat16" is faster on processors that multiply in it.
    held_still : attributes of the Gaussians, of `surrogate.gaussians.NAMES`, that F_sim does not move.
    visualization_steps : length of stage 3, per variation of the appearance that the catalog has.
    visualization_deformation : the design of F_vis; "auto" applies transfer functions ("values") and learns the rest ("bilinear").
    visualization_latent_size, visualization_hidden_width : as those above, of F_vis.
    visualization_color_degree : as `color_degree`, of the Gaussians that F_vis shows; "auto" lets validation images decide.
    simulation_rate_factor : what F_sim's rates are multiplied by where it is tuned along with F_vis; 0 freezes it.
    value_bins, value_rate : how many field values every Gaussian has weights of ("values"), and Adam's rate for those.
    mean_rate ... color_rate : of the canonical Gaussians.  latent_rate, embedding_rate : of the deformation.
    canonical_rate_factor : what stage 2 multiplies the canonical rates by.
    final_rate_factor : what all rates have decayed to, exponentially, at the end of a stage.
    mean_offset ... color_offset : how far one unit of the deformation's output moves each quantity.
    ssim_weight : of 1 - SSIM in the loss, beside the mean absolute error.
    deformation_penalty : weight in the loss of L_deform, the mean squared size of a learnt deformation's offsets; 0 for none.
    hard_example_power : images are drawn in proportion to this power of their running error, but none is forgotten; 0 draws all
        as often.
    relocation_interval : steps between relocations of dead Gaussians; 0 turns them off.
    relocation_stop : fraction of a stage after which no Gaussian is relocated.
    relocation_target : where dead Gaussians go: "opacity", onto living ones in proportion to that; "gradient", onto those at which
        pictures pull by more than `gradient_threshold` on the screen.
    dead_opacity : a Gaussian is dead where the decayed maximum of its deformed opacity lies below this.
    peak_decay : what that maximum is multiplied by per step.
    alpha_floor, alpha_cap, dilation : the rasterizer's smallest and largest alpha, and the variance (pixels squared) added to
        every projected Gaussian.
    device, backend : where training computes, "auto" being a GPU where torch and gsplat can use one, else "cpu"; and how it draws,
        of `surrogate.splatting.render`.
    fit_to_need : whether what the model does not need is taken from it at the end, as validation images tell: attributes that
        need not deform, modes of deformation, Gaussians, bits.  Where a catalog has no such images, nothing is.
    need_tolerance : what each of those choices may cost on validation images, in dB.
    recovery_fraction : steps after such a change, as a part of all steps.
    validation_interval, validation_images : steps between looks at how many fixed validation images; 0 for none.
    checkpoint_seconds : time between checkpoints.
    """

    seed: int = 0
    appearance: str = ""
    gaussians: int = 10_000
    initialization: Initialization = "auto"
    initial_opacity: float = 0.2
    initial_scale: float = 0.25
    color_degree: ColorDegree = "auto"

    canonical_steps: int = 2_000
    deformation_steps: int = 10_000
    latent_size: int = 16
    hidden_width: int = 64
    latent_spread: float = 0.25
    deformation: DeformationKind = "bilinear"
    field_precision: FieldPrecision = "float32"
    held_still: tuple[str, ...] = ()

    visualization_steps: int = 10_000
    visualization_deformation: VisualizationKind = "auto"
    visualization_latent_size: int = 16
    visualization_hidden_width: int = 64
    visualization_color_degree: ColorDegree = "auto"
    simulation_rate_factor: float = 0.1
    value_bins: int = 32
    value_rate: float = 2e-3

    mean_rate: float = 3e-3
    log_scale_rate: float = 6e-3
    quat_rate: float = 3e-3
    opacity_rate: float = 6e-2
    color_rate: float = 5e-3
    latent_rate: float = 5e-2
    embedding_rate: float = 1e-2
    canonical_rate_factor: float = 1.0
    final_rate_factor: float = 0.05

    mean_offset: float = 0.05
    log_scale_offset: float = 0.2
    quat_offset: float = 0.1
    opacity_offset: float = 1.0
    color_offset: float = 0.5

    ssim_weight: float = 0.2
    deformation_penalty: float = 0.0
    hard_example_power: float = 0.0
    relocation_interval: int = 100
    relocation_target: RelocationTarget = "opacity"
    gradient_threshold: float = 1e-4
    relocation_stop: float = 0.7
    dead_opacity: float = 0.01
    peak_decay: float = 0.995
    alpha_floor: float = Constants.alpha_floor
    alpha_cap: float = Constants.alpha_cap
    dilation: float = Constants.dilation
    device: Device = "auto"
    backend: str = "auto"

    fit_to_need: bool = True
    need_tolerance: float = 0.05
    recovery_fraction: float = 0.02

    validation_interval: int = 500
    validation_images: int = 16
    checkpoint_seconds: float = 30.0

    def __post_init__(self) -> None:
        for name in (
            "gaussians",
            "latent_size",
            "hidden_width",
            "visualization_latent_size",
            "visualization_hidden_width",
        ):
            _require(getattr(self, name) >= 1, self, name, "at least 1")
        for name in (
            "seed",
            "canonical_steps",
            "deformation_steps",
            "visualization_steps",
            "relocation_interval",
            "validation_interval",
            "validation_images",
        ):
            _require(getattr(self, name) >= 0, self, name, "at least 0")
        _require(self.value_bins >= 2, self, "value_bins", "at least 2")
        _require(set(self.held_still) <= set(NAMES), self, "held_still", f"some of {list(NAMES)}")
        for name in ("initial_opacity", "dead_opacity"):
            _require(0 < getattr(self, name) < 1, self, name, "between 0 and 1")
        for name in ("ssim_weight", "relocation_stop", "peak_decay", "alpha_floor", "recovery_fraction"):
            _require(0 <= getattr(self, name) <= 1, self, name, "in [0, 1]")
        for field in fields(self):
            if field.name == "simulation_rate_factor":  # zero freezes F_sim
                continue
            positive = field.name.endswith(("_rate", "_factor", "_offset", "_scale", "_spread", "_seconds"))
            _require(not positive or getattr(self, field.name) > 0, self, field.name, "positive")
        _require(self.alpha_floor < self.alpha_cap < 1, self, "alpha_cap", "above alpha_floor and below 1")
        for name, kind in typing.get_type_hints(type(self)).items():
            if typing.get_origin(kind) is Literal:
                options = typing.get_args(kind)
                _require(getattr(self, name) in options, self, name, f"one of {list(options)}")
        for name in (
            "dilation",
            "need_tolerance",
            "deformation_penalty",
            "hard_example_power",
            "simulation_rate_factor",
            "gradient_threshold",
        ):
            _require(getattr(self, name) >= 0, self, name, "at least 0")

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> TrainingSettings:
        """Settings from a scene's `[training]` table; keys that are absent keep their defaults.

        Raises ValueError naming an unknown key, a value of the wrong type or one out of range.
        """
        types = typing.get_type_hints(cls)
        unknown = sorted(set(table) - set(types))
        if unknown:
            raise ValueError(f"training: unknown keys {unknown}; known are {sorted(types)}")
        return cls(**{name: _typed(name, value, types[name]) for name, value in table.items()})

    def for_visualization(self) -> TrainingSettings:
        """The same with F_vis's sizes where F_sim's stand."""
        return replace(self, latent_size=self.visualization_latent_size, hidden_width=self.visualization_hidden_width)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values that `from_table` turns back into the same settings."""
        values = asdict(self)
        for name in ("held_still", "field_precision"):  # so that runs from before there were these are still recognized
            if values[name] == type(self).__dataclass_fields__[name].default:
                del values[name]
        return values


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


def _require(condition: bool, settings: TrainingSettings, name: str, what: str) -> None:
    if not condition:
        raise ValueError(f"training.{name} must be {what}, got {getattr(settings, name)!r}")
