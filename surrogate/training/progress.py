"""What training tells about itself while it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


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
        parts = [f"{self.stage:<11} {self.step:>6} / {self.steps}"]
        if self.rate:
            parts.append(f"{self.rate:.1f} steps/s")
        if self.loss is not None:
            parts.append(f"loss {self.loss:.4f}")
        if self.psnr is not None:
            parts.append(f"validation {self.psnr:.2f} dB")
        if self.seconds_left is not None:
            parts.append(f"{int(self.seconds_left) // 60}:{int(self.seconds_left) % 60:02d} left")
        return "  ".join(parts)


ProgressReport = Callable[[TrainingProgress], None]
