"""The state of a training, which its steps hand on and a checkpoint holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import torch
from torch import Tensor

from surrogate.appearance.field_gaussians import AnyGaussians, load_gaussians
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians
from surrogate.storage.checkpoints import Checkpoint
from surrogate.storage.encoding import Encoding
from surrogate.storage.names import joined, part_of
from surrogate.training.loop import LoopMemory
from surrogate.training.stages import Stage

WARM_FACTOR = 0.3  # of all rates in a training that goes on from a finished model

RECORDED = (
    "done",
    "losses",
    "curve",
    "choices",
    "seconds",
    "processor_seconds",
    "steps_before",
)  # in a checkpoint's record as they are


class FittedGaussians(NamedTuple):
    """The result of stages 1 and 2: canonical Gaussians and the simulation deformation."""

    gaussians: AnyGaussians
    deformation: BilinearDeformation

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> FittedGaussians:
        """The fit with these `tensors()` and this `record()`."""
        deformation = BilinearDeformation.load(part_of(tensors, "deformation"), record)
        return cls(load_gaussians(part_of(tensors, "gaussians"), record.get("field")), deformation)

    def copy(self) -> FittedGaussians:
        """The same numbers in tensors of their own."""
        return FittedGaussians(self.gaussians.copy(), self.deformation.copy())

    def to(self, device: torch.device) -> FittedGaussians:
        """The same on another device."""
        return FittedGaussians(self.gaussians.to(device), self.deformation.to(device))

    def at(self, parameters: Tensor) -> Gaussians:
        """The Gaussians that are drawn at normalized parameters (P,)."""
        return self.deformation.deformed(self.gaussians, parameters).drawn()

    def without(self, attribute: str) -> FittedGaussians:
        """The same with one of the Gaussians' attributes frozen."""
        return FittedGaussians(self.gaussians, self.deformation.without(attribute))

    def of(self, rows: Tensor) -> FittedGaussians:
        """The same with only some Gaussians, by index (M,)."""
        return FittedGaussians(self.gaussians.of(rows), self.deformation.of(rows))

    def tensors(self) -> dict[str, Tensor]:
        """All that would be stored."""
        return joined({"gaussians": self.gaussians.tensors(), "deformation": self.deformation.stored()})

    def record(self) -> dict[str, Any]:
        """JSON values that `load` needs beside the tensors."""
        return {**self.deformation.record(), **self.gaussians.record()}

    @property
    def megabytes(self) -> float:
        """10^6 bytes in float32."""
        return 4e-6 * sum(tensor.numel() for tensor in self.tensors().values())


@dataclass(frozen=True, eq=False, repr=False)
class TrainingState:
    """The state of a training: its place, its fit, and the loop's memory.

    Attributes
    ----------
    fitted : canonical Gaussians and the simulation deformation.
    done : how many steps of `surrogate.training.steps.plan` are finished.
    loop : the loop's memory in the stage that is in progress; None between stages.
    visualizations : of each variation that has begun.
    losses : of the steps since the last point of `curve`.
    curve, choices : as in a model's `training`.
    seconds, processor_seconds : that training has taken, and those of all cores.
    steps_before : of trainings whose model this one goes on from.
    encodings : of the model's tensors, by name; no checkpoint holds them, for the last step chooses them.
    """

    fitted: FittedGaussians
    done: int = 0
    loop: LoopMemory | None = None
    visualizations: tuple[Visualization, ...] = ()
    losses: tuple[float, ...] = ()
    curve: tuple[Mapping[str, Any], ...] = ()
    choices: tuple[Mapping[str, Any], ...] = ()
    seconds: float = 0.0
    processor_seconds: float = 0.0
    steps_before: int = 0
    encodings: Mapping[str, Encoding] = field(default_factory=dict)

    def copy(self) -> TrainingState:
        """The same numbers in tensors of their own, but for the loop's."""
        return replace(self, fitted=self.fitted.copy(), visualizations=tuple(v.copy() for v in self.visualizations))

    def to(self, device: torch.device) -> TrainingState:
        """The same on another device, but for the loop's tensors."""
        visualizations = tuple(v.to(device) for v in self.visualizations)
        return replace(self, fitted=self.fitted.to(device), visualizations=visualizations)

    def slowed(self, stage: Stage) -> Stage:
        """A stage of this training: at lower rates where it goes on from a finished model."""
        if not self.steps_before:
            return stage
        return replace(stage, rates={name: WARM_FACTOR * rate for name, rate in stage.rates.items()})

    def checkpoint(self, fingerprint: str) -> Checkpoint:
        """The checkpoint that `load` reads, of the run with this fingerprint."""
        parts = {"fitted": self.fitted.tensors()}
        parts |= {f"visualization{i}": v.stored() for i, v in enumerate(self.visualizations)}
        record = {
            "fingerprint": fingerprint,
            "fitted": self.fitted.record(),
            "visualizations": [v.record() for v in self.visualizations],
            "step": None if self.loop is None else self.loop.step,
        }
        record |= {name: getattr(self, name) for name in RECORDED}
        return Checkpoint(joined(parts | ({} if self.loop is None else {"loop": self.loop.tensors})), record)

    @classmethod
    def load(cls, checkpoint: Checkpoint) -> TrainingState:
        """The state that a checkpoint was made of, in main memory."""
        tensors, record = checkpoint.tensors, checkpoint.record
        visualizations = enumerate(record["visualizations"])
        return cls(
            fitted=FittedGaussians.load(part_of(tensors, "fitted"), record["fitted"]),
            done=record["done"],
            loop=None if record["step"] is None else LoopMemory(record["step"], part_of(tensors, "loop")),
            visualizations=tuple(
                Visualization.load(part_of(tensors, f"visualization{i}"), v) for i, v in visualizations
            ),
            seconds=record["seconds"],
            processor_seconds=record["processor_seconds"],
            steps_before=record.get("steps_before", 0),
            losses=tuple(record["losses"]),
            curve=tuple(record["curve"]),
            choices=tuple(record["choices"]),
        )
