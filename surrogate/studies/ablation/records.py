"""The result of one fit, and the folder that keeps them: a small file each, there whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from catalogs import durable
from surrogate.settings import TrainingSettings
from surrogate.studies.ablation.variants import VARIANTS, Variant

TIME_TOLERANCE = 0.15  # of the budget
Stamp = tuple[int, int]  # of a file: another one after it was replaced


@dataclass(frozen=True)
class Result:
    """What came of one variant and seed.

    Attributes
    ----------
    budget : seconds that a fit of the study is given.
    budgets : how many of them this one was given.
    mark : the fingerprint of the catalog and of the settings that all variants depart from.
    settings : the variant's, before steps were fitted to the budget, as JSON values.
    canonical_steps, deformation_steps, visualization_steps : that were taken.
    seconds : of training, from its first image to its last step, by `surrogate.studies.ablation.clock`.
    psnr, ssim : means over the `images` validation images; psnr in dB.
    gaussians : how many there were.
    pace : seconds before the first step, and of a step in either stage, as they were measured before.
    machine, commit : where this was computed, and by what.
    error : why there is no result; "" where there is one.
    """

    variant: str
    seed: int
    budget: float
    mark: str
    settings: dict[str, Any]
    budgets: float = 1.0
    canonical_steps: int = 0
    deformation_steps: int = 0
    visualization_steps: int = 0
    seconds: float = 0.0
    psnr: float = 0.0
    ssim: float = 0.0
    images: int = 0
    gaussians: int = 0
    pace: Sequence[float] = ()
    machine: dict[str, str | int] | None = None
    commit: str = ""
    error: str = ""

    @property
    def steps(self) -> int:
        """Of all stages."""
        return self.canonical_steps + self.deformation_steps + self.visualization_steps

    @property
    def is_timely(self) -> bool:
        """Whether training took about as long as it should: not where the machine was busier or idler than when it was probed."""
        return abs(self.seconds / (self.budgets * self.budget) - 1.0) <= TIME_TOLERANCE


@dataclass(frozen=True)
class Records:
    """The results of one study of `variants`: those in `folder` that were made with this mark and budget, from these settings."""

    folder: Path
    mark: str
    base: TrainingSettings
    budget: float
    variants: Sequence[Variant] = VARIANTS

    def settings(self, variant: Variant, seed: int) -> TrainingSettings:
        """The variant's, before steps are fitted to the budget; seeds are counted from the scene's."""
        return replace(variant.settings(self.base), seed=self.base.seed + seed)

    def result(self, variant: Variant, seed: int, **found: Any) -> Result:
        """A result of this study."""
        try:
            settings = self.settings(variant, seed).to_json()
        except ValueError:  # such settings can't be: `found` holds the error
            settings = {}
        return Result(variant.name, seed, self.budget, self.mark, settings, variant.budgets, **found)

    def save(self, result: Result) -> None:
        """Keep a result, at once and whole."""
        durable.make_folder(self.folder)
        text = json.dumps(asdict(result), indent=1)
        durable.replace(self._path(result.variant, result.seed), text.encode())

    def find(self, variant: Variant, seed: int) -> Result | None:
        """What this study knows of a variant and seed, a failure included; None for nothing, or for what is out of date."""
        try:
            found = Result(**json.loads(self._path(variant.name, seed).read_text()))
            kept = {} if not found.settings else TrainingSettings.from_table(found.settings).to_json()
        except (OSError, ValueError, TypeError):
            return None
        same = (found.variant, found.seed, found.mark, found.budget, found.budgets) == (
            variant.name,
            seed,
            self.mark,
            self.budget,
            variant.budgets,
        )
        return found if same and kept == self.result(variant, seed).settings else None

    def stamp(self, variant: Variant, seed: int) -> Stamp | None:
        """Tells a result that is kept from one that has taken its place since, however alike; None without any."""
        try:
            found = self._path(variant.name, seed).stat()
        except OSError:
            return None
        return found.st_ino, found.st_mtime_ns

    def of(self, variant: Variant) -> list[Result]:
        """All that this study knows of a variant, by seed."""
        seeds = sorted(
            int(number)
            for path in self.folder.glob(f"{variant.name}.seed*.json")
            if (number := path.stem.rpartition("seed")[2]).isdigit()
        )
        return [result for seed in seeds if (result := self.find(variant, seed)) is not None]

    def _path(self, name: str, seed: int) -> Path:
        return self.folder / f"{name}.seed{seed}.json"
