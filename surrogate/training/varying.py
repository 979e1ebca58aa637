"""Stage 3 between its variations: what has been learnt, and what a checkpoint must hold of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from surrogate.deformation.visualization import Visualization
from surrogate.storage.checkpoints import Checkpoint, part_of


@dataclass(frozen=True, eq=False)
class Varying:
    """Visualizations that are finished, and the colour degree of the one that is being trained, once it is chosen."""

    finished: tuple[Visualization, ...] = ()
    color_degree: int | None = None

    def tensors(self) -> dict[str, Tensor]:
        """All tensors of what is finished."""
        return {f"visualization{i}.{n}": t for i, v in enumerate(self.finished) for n, t in v.stored().items()}

    def record(self) -> dict[str, Any]:
        """JSON values that `restored` needs beside the tensors."""
        return {"color_degree": self.color_degree, "finished": [v.record() for v in self.finished]}

    @classmethod
    def restored(cls, checkpoint: Checkpoint | None) -> Varying:
        """The state that a checkpoint was taken in; the first one without."""
        record: Mapping[str, Any] | None = None if checkpoint is None else checkpoint.record.get("varying")
        if checkpoint is None or record is None:
            return cls()
        finished = (
            Visualization.load(part_of(checkpoint.tensors, f"visualization{i}"), form)
            for i, form in enumerate(record["finished"])
        )
        return cls(tuple(finished), record["color_degree"])
