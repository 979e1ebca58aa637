"""What is changed, one thing at a time: settings as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from surrogate.settings import TrainingSettings

DEFAULT = "default"
PAPER = "paper"
GEOMETRY = ("means", "log_scales", "quats")
LOOKS = ("opacity_logits", "colors")


@dataclass(frozen=True, eq=False)
class Variant:
    """One departure from a scene's settings.

    Attributes
    ----------
    name : what it is called, on the command line and in file names.
    why : what it is meant to tell, in one sentence.
    changes : values of `TrainingSettings`.
    factors : what numbers of `TrainingSettings` are multiplied by.
    steps_of : name of the variant whose number of steps it takes, whatever time that needs; "" for as many as fit into the budget.
    budgets : how many budgets it is given.
    """

    name: str
    why: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    factors: Mapping[str, float] = field(default_factory=dict)
    steps_of: str = ""
    budgets: float = 1.0

    def settings(self, base: TrainingSettings) -> TrainingSettings:
        """`base` with the changes; raises ValueError for values that can't be."""
        scaled: dict[str, Any] = {name: _scaled(base.to_json()[name], factor) for name, factor in self.factors.items()}
        moved: dict[str, Any] = {}
        if self.changes.get("canonical_steps") == 0:  # learnt jointly, in as many steps
            moved = {"deformation_steps": base.steps.canonical + base.steps.deformation}
        return base.changed(**scaled, **self.changes, **moved)

    @property
    def what(self) -> str:
        """The changes in a few words, for a table."""
        parts = [f"{name} = {_shown(value)}" for name, value in self.changes.items()]
        parts += [f"{name} × {factor:g}" for name, factor in self.factors.items()]
        parts += [f"{self.budgets:g} times the time"] if self.budgets != 1.0 else []
        return ", ".join([*parts, *([f"steps of {self.steps_of}"] if self.steps_of else [])]) or "nothing"


def selected(names: Iterable[str], among: Sequence[Variant]) -> list[Variant]:
    """The variants of these names, all for none, in the table's order, with what they are compared with and depend on.

    Raises ValueError for an unknown name.
    """
    known = {variant.name: variant for variant in among}
    wanted = set(names) or set(known)
    unknown = sorted(wanted - set(known))
    if unknown:
        raise ValueError(f"unknown variants {unknown}; known are {list(known)}")
    needed = {DEFAULT} | {known[name].steps_of for name in wanted}
    return [variant for variant in among if variant.name in wanted | needed]


def _scaled(value: float, factor: float) -> float:
    return max(1, round(value * factor)) if isinstance(value, int) else value * factor


def _shown(value: Any) -> str:
    return " and ".join(value) if isinstance(value, tuple) else f"{value:g}" if isinstance(value, float) else str(value)


def _each(setting: str, why: str, named: Mapping[str, Any], *, scaled: bool = False) -> list[Variant]:
    """A variant for each value of a setting, or with `scaled` each factor of it, by name."""
    changes: list[tuple[str, dict[str, Any]]] = [(name, {setting: value}) for name, value in named.items()]
    return [Variant(name, why, factors=of) if scaled else Variant(name, why, of) for name, of in changes]


FIELD, FIELD_OF_F_VIS = {"deformation": PAPER}, {"visualization_deformation": PAPER}
FAST = {"field_precision": "bfloat16"}
AS_GIVEN = "what the scene's settings give; all others are compared with it"
FASTEST = "the same in the precision that processors with matrix units are fastest in"
MORE_OFTEN = "images that are badly reproduced are shown more often, as in GS-Surrogate, whose power is 1.5"
SMALL_OFFSETS = "small offsets are preferred, as L_deform of GS-Surrogate does"
DECAY = "what it is worth that all rates fall"
COOLDOWN = "what it is worth that all rates fall to 0 at the end, rather than to a twentieth"

# The first is what the others are compared with; one that takes another's steps stands after it.
VARIANTS = (
    Variant(DEFAULT, AS_GIVEN),
    Variant(PAPER, "the deformation field of GS-Surrogate instead of the bilinear one", FIELD),
    Variant("paper-bfloat16", FASTEST, FIELD | FAST),
    Variant("paper-bfloat16-x10", "what ten times the time does for the paper's field", FIELD | FAST, budgets=10.0),
    *_each(
        "canonical_rate_factor",
        "whether the deformation learns better where the canonical Gaussians hardly move in stage 2",
        {"canonical-rate-0.1": 0.1, "canonical-rate-0.01": 0.01, "canonical-rate-0.001": 0.001},
        scaled=True,
    ),
    Variant("geometry-only", "whether places and shapes alone can follow the parameters", {"held_still": LOOKS}),
    Variant("looks-only", "whether opacities and colours alone can follow the parameters", {"held_still": GEOMETRY}),
    *_each("hard_example_power", MORE_OFTEN, {"hard-examples-1": 1.0, "hard-examples-1.5": 1.5}),
    *_each(
        "deformation_penalty", SMALL_OFFSETS, {f"deformation-penalty-{w}": float(w) for w in ("1e-4", "1e-3", "1e-2")}
    ),
    Variant("no-decay", DECAY, {"final_rate_factor": 1.0, "cooldown": 0.0}),
    Variant("no-cooldown", COOLDOWN, {"final_rate_factor": 0.05, "cooldown": 0.0}),
    Variant(
        "gradient-relocation",
        "dead Gaussians go where pictures pull, as densification chooses, not where opacity is",
        {"relocation_target": "gradient"},
    ),
    Variant("no-relocation", "what moving dead Gaussians is worth", {"relocation_interval": 0}),
    Variant("joint", "whether a stage of its own for the canonical Gaussians is needed", {"canonical_steps": 0}),
    *_each(
        "initialization",
        "where the Gaussians start, which training may or may not forget",
        {f"start-{start}": start for start in ("random", "hull", "sfm", "in-situ")},
    ),
    *_each(
        "gaussians",
        "detail against steps: more Gaussians show more, and take longer",
        {"gaussians-x0.5": 0.5, "gaussians-x2": 2.0},
        scaled=True,
    ),
    Variant("samples-2", "whether a pixel is better the mean of four samples, which take longer", {"samples": 2}),
    Variant("colors", "Gaussians that carry colours instead of the field's values", {"carried": "colors"}),
    Variant("pictures-alone", "what the field's values at points teach beside pictures", {"field_value_weight": 0.0}),
    *_each("latent_size", "how many modes of deformation the Gaussians share", {"latent-8": 8, "latent-32": 32}),
    *_each("ssim_weight", "how much structure weighs beside absolute differences", {"ssim-0": 0.0, "ssim-0.5": 0.5}),
    Variant(
        "default-in-paper-steps",
        "both deformations after equally many steps, as few as the paper's takes in the budget",
        steps_of=PAPER,
    ),
    Variant(
        "paper-in-default-steps",
        "both deformations after equally many steps, as many as the default takes in the budget",
        FIELD,
        steps_of=DEFAULT,
    ),
)
VISUALIZATION_VARIANTS = (
    Variant(DEFAULT, AS_GIVEN),
    Variant(PAPER, "the deformation field of GS-Surrogate, without its backbone, as F_vis", FIELD_OF_F_VIS),
    Variant("paper-bfloat16", FASTEST, FIELD_OF_F_VIS | FAST),
    Variant("paper-bfloat16-x10", "what ten times the time does for it", FIELD_OF_F_VIS | FAST, budgets=10.0),
    *_each("visualization_deformation", "another design of F_vis", {"bilinear": "bilinear", "values": "values"}),
    *_each(
        "simulation_rate_factor",
        "how much F_sim is tuned along with F_vis, where it is",
        {"simulation-rate-0": 0.0, "simulation-rate-0.01": 0.01, "simulation-rate-1": 1.0},
    ),
    Variant("surface-samples-1", "what four samples a pixel are worth on lit surfaces", {"surface_samples": 1}),
    *_each("visualization_latent_size", "how many modes F_vis has", {"latent-8": 8, "latent-32": 32}),
    *_each(
        "value_bins", "of how many field values every Gaussian has weights", {"value-bins-16": 16, "value-bins-64": 64}
    ),
    *_each("hard_example_power", MORE_OFTEN, {"hard-examples-1": 1.0}),
    *_each("deformation_penalty", SMALL_OFFSETS, {"deformation-penalty-1e-3": 1e-3}),
    Variant("no-decay", DECAY, {"final_rate_factor": 1.0, "cooldown": 0.0}),
    Variant("no-cooldown", COOLDOWN, {"final_rate_factor": 0.05, "cooldown": 0.0}),
    Variant(
        "default-in-paper-steps",
        "both designs after equally many steps, as few as the paper's takes in the budget",
        steps_of="paper-bfloat16",
    ),
)
