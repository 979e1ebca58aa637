"""Variants of an ablation, one change at a time: settings as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from surrogate.settings import TrainingSettings

DEFAULT = "default"


@dataclass(frozen=True, eq=False)
class Variant:
    """One departure from a scene's settings.

    Attributes
    ----------
    name : name on the command line and in file names.
    why : the question that it answers, in one sentence.
    changes : values of `TrainingSettings`.
    factors : factors on numbers of `TrainingSettings`.
    steps_of : name of the variant whose number of steps it takes, whatever time that needs; "" for as many as fit into
        the budget.
    """

    name: str
    why: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    factors: Mapping[str, float] = field(default_factory=dict)
    steps_of: str = ""

    def settings(self, base: TrainingSettings) -> TrainingSettings:
        """`base` with the changes; raises ValueError for invalid values."""
        scaled: dict[str, Any] = {name: _scaled(base.to_json()[name], factor) for name, factor in self.factors.items()}
        moved: dict[str, Any] = {}
        if self.changes.get("canonical_steps") == 0:  # learnt jointly, in as many steps
            moved = {"deformation_steps": base.canonical_steps + base.deformation_steps}
        return base.changed(**scaled, **self.changes, **moved)

    @property
    def what(self) -> str:
        """The changes in a few words, for a table."""
        parts = [f"{name} = {_shown(value)}" for name, value in self.changes.items()]
        parts += [f"{name} × {factor:g}" for name, factor in self.factors.items()]
        return ", ".join([*parts, *([f"steps of {self.steps_of}"] if self.steps_of else [])]) or "nothing"


def selected(names: Iterable[str], among: Sequence[Variant]) -> list[Variant]:
    """The variants of these names, by default all, in the table's order, with the variants that they depend on.

    Raises ValueError for an unknown name.
    """
    by_name = {variant.name: variant for variant in among}
    wanted = set(names) or set(by_name)
    unknown = sorted(wanted - set(by_name))
    if unknown:
        raise ValueError(f"unknown variants {unknown}; known are {list(by_name)}")
    needed = {DEFAULT} | {by_name[name].steps_of for name in wanted}
    return [variant for variant in among if variant.name in wanted | needed]


def _scaled(value: float, factor: float) -> float:
    return max(1, round(value * factor)) if isinstance(value, int) else value * factor


def _shown(value: Any) -> str:
    return " and ".join(value) if isinstance(value, tuple) else f"{value:g}" if isinstance(value, float) else str(value)


def _each(setting: str, why: str, named: Mapping[str, Any], *, scaled: bool = False) -> list[Variant]:
    """A variant by name for each value of a setting, or with `scaled` for each factor on it."""
    changes: list[tuple[str, dict[str, Any]]] = [(name, {setting: value}) for name, value in named.items()]
    return [Variant(name, why, factors=of) if scaled else Variant(name, why, of) for name, of in changes]


AS_GIVEN = "what the scene's settings give; all others are compared with it"

# the others are compared with the first
VARIANTS = (
    Variant(DEFAULT, AS_GIVEN),
    Variant("no-relocation", "what moving dead Gaussians is worth", {"relocation_interval": 0}),
    Variant("joint", "whether a stage of its own for the canonical Gaussians is needed", {"canonical_steps": 0}),
    *_each(
        "initialization",
        "where the Gaussians start, which training may or may not forget",
        {f"start-{start}": start for start in ("random", "sfm", "in-situ")},
    ),
    *_each(
        "gaussians",
        "detail against steps: more Gaussians show more, and take longer",
        {"gaussians-x0.5": 0.5, "gaussians-x2": 2.0},
        scaled=True,
    ),
    Variant("samples-2", "whether a pixel is better the mean of four samples, which take longer", {"samples": 2}),
    Variant(
        "samples-2-in-default-steps",
        "the same after equally many steps, as many as the default takes in the budget",
        {"samples": 2},
        steps_of=DEFAULT,
    ),
    Variant("colors", "Gaussians that carry colours instead of the field's values", {"carried": "colors"}),
    Variant("pictures-alone", "what the field's values at points teach beside pictures", {"field_value_weight": 0.0}),
    *_each("latent_size", "how many modes of deformation the Gaussians share", {"latent-8": 8, "latent-32": 32}),
    Variant(
        "default-in-samples-2-steps",
        "both after equally many steps, as few as four samples a pixel allow in the budget",
        steps_of="samples-2",
    ),
)
VISUALIZATION_VARIANTS = (
    Variant(DEFAULT, AS_GIVEN),
    Variant("surface-samples-1", "what four samples a pixel are worth on lit surfaces", {"surface_samples": 1}),
    Variant(
        "default-in-surface-samples-1-steps",
        "both after equally many steps, as many as one sample a pixel allows in the budget",
        steps_of="surface-samples-1",
    ),
)
