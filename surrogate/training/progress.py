"""What training tells about itself while it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from catalogs.progress import joined, per_second, time_left


@dataclass(frozen=True)
class TrainingProgress:
    """Where training stands.

    Attributes
    ----------
    stage : "loading", "canonical", "colour degree", "deformation" or "needs".
    step, steps : done and planned, over all stages; of the choices that are made at the end in "needs".
    rate : steps per second, lately; 0 before it is known.
    loss : running mean of the training loss.
    psnr : the last validation PSNR in dB; None before the first.
    seconds_left : at this rate; None before it is known.
    """

    stage: str
    step: int
    steps: int
    rate: float = 0.0
    loss: float | None = None
    psnr: float | None = None
    seconds_left: float | None = None

    def __str__(self) -> str:
        return joined(
            f"{self.stage:<11} {self.step:>6} / {self.steps}",
            per_second(self.rate, "steps"),
            "" if self.loss is None else f"loss {self.loss:.4f}",
            "" if self.psnr is None else f"validation {self.psnr:.2f} dB",
            time_left(self.seconds_left),
        )


ProgressReport = Callable[[TrainingProgress], None]
