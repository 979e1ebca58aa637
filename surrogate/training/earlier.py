"""Checkpoints of versions that kept the stage's name and its tensors in place of the whole state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch

from surrogate.deformation.visualization import Visualization
from surrogate.storage.checkpoints import Checkpoint
from surrogate.storage.names import part_of
from surrogate.training.loop import LoopMemory
from surrogate.training.source import Source
from surrogate.training.state import Fitted, TrainingState
from surrogate.training.steps import COMPRESSION, Decide, Optimize, Step
from surrogate.training.visualizations import shared_visualization


def state_of(checkpoint: Checkpoint, first: Fitted, source: Source, plan: Sequence[Step]) -> TrainingState:
    """The state of an earlier version's checkpoint, on the device of `first`, what training begins with."""
    tensors, record, fitted = checkpoint.tensors, checkpoint.record, first
    device, varying = fitted.gaussians.means.device, record.get("varying", {"finished": [], "color_degree": None})
    if "deformation" in record:  # stage 2 is over
        fitted = Fitted.load(part_of(tensors, "fitted"), record["deformation"]).to(device)
    elif record["color_degree"]:
        fitted = fitted._replace(gaussians=fitted.gaussians.with_color_degree(record["color_degree"]))
    shown = [
        Visualization.load(part_of(tensors, f"visualization{i}"), form).to(device)
        for i, form in enumerate(varying["finished"])
    ]
    place, variations = len(shown), source.variations
    optimizing = [i for i, step in enumerate(plan) if isinstance(step, Optimize)]
    if record["stage"] == "needs":
        deciding = [i for i, step in enumerate(plan) if isinstance(step, Decide) and step.stage == COMPRESSION]
        done = (deciding[0] if deciding else len(plan)) + record["needs"]
    elif record["stage"] in ("canonical", "deformation"):
        again = record["stage"] == "deformation"
        done = optimizing[-1 - len(variations)] if again and record["color_degree"] is not None else optimizing[again]
    else:
        done = optimizing[place - len(variations)]
        degree = varying["color_degree"] or 0
        shown.append(shared_visualization(*fitted, variations[place], source, degree))
    told: dict[str, Any] = {name: tuple(record[name]) for name in ("losses", "curve", "choices")}
    state = TrainingState(fitted, done, None, tuple(shown), **told, seconds=record["seconds"], processor_seconds=None)
    step = plan[done] if done < len(plan) else None
    if not isinstance(step, Optimize):
        return state
    memory = {name.replace("pulls.", "screen_gradients."): t for name, t in part_of(tensors, "run").items()}
    with torch.no_grad():
        for name, tensor in step.stage(state).tensors.items():
            tensor.copy_(memory.pop(name))
    return replace(state, loop=LoopMemory(record["step"], memory))
