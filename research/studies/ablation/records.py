"""Results of an ablation's fits, each in a record of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from research.studies.ablation.experiments import Experiment
from research.studies.ablation.variants import Variant
from surrogate.settings import TrainingSettings
from surrogate.storage.records import Provenance, Record

KIND, VERSION = "ablation", 1
KEY = ("variant", "seed", "budget", "mark", "scene", "settings")
DECIDING = "research.studies.ablation.timing"  # decides the number of steps, beside training and evaluation
TIME_TOLERANCE = 0.15  # of the budget


@dataclass(frozen=True)
class AblationResult:
    """The result of one variant and seed.

    Attributes
    ----------
    budget : seconds for each fit of the study.
    mark : fingerprint of the catalog and of the common settings.
    settings : the variant's settings before steps were fitted to the budget, as JSON values.
    scene : the scene's settings.
    canonical_steps, deformation_steps, visualization_steps : steps of each stage.
    seconds : of training, from its first image to its last step, by `research.studies.ablation.timing.clock`.
    psnr, ssim : means over the `images` validation images; psnr in dB.
    gaussians : number of Gaussians.
    step_times : seconds before the first step, and per step in each stage, as measured beforehand.
    error : the reason for a missing result; "" if there is one.
    """

    variant: str
    seed: int
    budget: float
    mark: str
    settings: Mapping[str, Any]
    scene: Mapping[str, Any] = field(default_factory=dict)
    canonical_steps: int = 0
    deformation_steps: int = 0
    visualization_steps: int = 0
    seconds: float = 0.0
    psnr: float = 0.0
    ssim: float = 0.0
    images: int = 0
    gaussians: int = 0
    step_times: Sequence[float] = ()
    error: str = ""
    provenance: Provenance = field(default_factory=Provenance)

    def __post_init__(self) -> None:
        figures = (self.seconds, self.psnr, self.ssim, self.steps, self.images, self.gaussians)
        numbers = all(type(number) in (int, float) for number in (self.budget, *figures))
        if type(self.seed) is not int or not numbers:
            raise TypeError(f"seeds, figures and steps must be numbers, got {self!r}")

    @property
    def steps(self) -> int:
        """Of all stages."""
        return self.canonical_steps + self.deformation_steps + self.visualization_steps

    @property
    def is_timely(self) -> bool:
        """True if training took about the planned time; False where the machine's load has changed since steps were timed."""
        return abs(self.seconds / self.budget - 1.0) <= TIME_TOLERANCE


@dataclass(frozen=True, eq=False)
class Records:
    """The results of one study in `folder`, of the variants of `experiment`, with `budget` seconds each."""

    folder: Path
    experiment: Experiment
    budget: float

    def settings(self, variant: Variant, seed: int) -> TrainingSettings:
        """The variant's settings before steps are fitted to the budget; seeds are counted from the scene's."""
        return variant.settings(self.experiment.base).changed(seed=self.experiment.base.seed + seed)

    def result(self, variant: Variant, seed: int, **values: Any) -> AblationResult:
        """A result of this study."""
        try:
            settings = self.settings(variant, seed).to_json()
        except ValueError:  # invalid settings: `found` holds the error
            settings = {}
        scene = self.experiment.scene.to_json()
        return AblationResult(variant.name, seed, self.budget, self.experiment.mark, settings, scene, **values)

    def save(self, result: AblationResult) -> None:
        """Store a result atomically."""
        Record.of(KIND, VERSION, result, KEY).save(self._path(result.variant, result.seed))

    def find(self, variant: Variant, seed: int) -> AblationResult | None:
        """The current result of a variant and seed, a failure included; None without one."""
        wanted = asdict(self.result(variant, seed))
        key = {name: wanted[name] for name in KEY}
        record = Record.load(self._path(variant.name, seed), KIND, VERSION, key)
        return None if record is None else record.to(AblationResult)

    def all(self) -> list[AblationResult]:
        """All current results of this study, by seed."""
        named = {variant.name: variant for variant in self.experiment.variants}
        there = load_results(self.folder, mark=self.experiment.mark, budget=self.budget)
        results = [self.find(named[one.variant], one.seed) for one in there if one.variant in named]
        return [result for result in results if result is not None]

    def _path(self, name: str, seed: int) -> Path:
        return self.folder / f"{name}.seed{seed}.json"


def load_results(folder: Path, **key: Any) -> list[AblationResult]:
    """All results in a folder that agree with `key`, by seed."""
    results = [record.to(AblationResult) for record in Record.load_all(folder, KIND, VERSION, key).values()]
    return sorted((result for result in results if result is not None), key=lambda result: result.seed)
