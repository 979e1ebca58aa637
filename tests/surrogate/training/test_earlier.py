"""Checkpoints in the layout of earlier versions, made from those of this one, and the model that training ends with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from catalogs.store.catalog import Catalog
from surrogate import TrainingSettings, train
from surrogate.storage.checkpoints import Checkpoint
from surrogate.storage.names import part_of
from surrogate.training.session import TrainingProgress
from surrogate.training.state import TrainingState
from tests.support.field_blobs import field_catalog
from tests.support.interruptions import interrupt, outcome

QUICK = TrainingSettings(
    carried="colors",
    gaussians=40,
    canonical_steps=6,
    deformation_steps=10,
    visualization_steps=8,
    latent_size=3,
    hidden_width=4,
    value_bins=6,
    validation_interval=5,
    relocation_interval=5,
    relocation_target="gradient",
    checkpoint_seconds=1e6,
)
MOMENTS: dict[str, Callable[[TrainingProgress], bool]] = {
    "stage 1": lambda p: p.step == 4,
    "before the colour degree": lambda p: p.step == 7,
    "stage 2": lambda p: p.step == 10,
    "a choice": lambda p: p.stage == "compression" and p.step == 1,
    "first variation": lambda p: p.stage == "isovalue" and p.step == 19,
    "second variation": lambda p: p.stage == "transfer_function" and p.step == 27,
}


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    path = tmp_path_factory.mktemp("varied") / "field.cdb"
    members = (("train", 0.0), ("train", 1.0), ("validation", 0.4))
    return field_catalog(path, members=members, view_splits=("train",) * 2 + ("validation",), summaries=True)


@pytest.fixture(scope="module")
def undisturbed(catalog: Catalog, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed") / "surrogate"
    train(QUICK, catalog, folder)
    return folder


def as_before(checkpoint: Checkpoint, catalog: Catalog) -> Checkpoint:
    """The layout of version 5092ad6: the stage's name, its trained tensors among the loop's, F_vis in training apart."""
    state, kinds = TrainingState.load(checkpoint), [v.kind for v in catalog.plan.variations]
    before = 4 + 3  # stages 1 and 2 with their question, then three choices
    number, fitted = (state.done - before) // 2, {f"fitted.{name}": t for name, t in state.fitted.tensors().items()}
    run: dict[str, torch.Tensor] = {} if state.loop is None else dict(state.loop.tensors)
    run = {name.replace("screen_gradients.", "pulls."): tensor for name, tensor in run.items()}
    record: dict[str, Any] = {
        name: checkpoint.record[name] for name in ("fingerprint", "curve", "losses", "choices", "seconds")
    }
    record |= {"color_degree": 0 if state.done > 2 else None, "step": 0 if state.loop is None else state.loop.step}
    if state.done < 4:
        record["stage"] = "canonical" if state.done == 0 else "deformation"
        run |= state.fitted.gaussians.tensors()
        if state.done:
            run |= {f"deformation.{name}": t for name, t in state.fitted.deformation.tensors().items()}
        return Checkpoint({f"run.{name}": t for name, t in run.items()}, record)
    record |= {"deformation": state.fitted.record(), "needs": min(state.done - 4, 3)}
    if state.done < before:
        return Checkpoint(fitted, {**record, "stage": "needs", "step": state.done - 4})
    *finished, begun = state.visualizations
    run |= {f"visualization.{name}": t for name, t in begun.deformation.tensors().items()}
    if begun.simulation is not None:
        run |= {f"simulation.{name}": t for name, t in begun.simulation.tensors().items()}
    shown = {f"visualization{i}.{name}": t for i, v in enumerate(finished) for name, t in v.stored().items()}
    record |= {
        "stage": kinds[number],
        "varying": {"color_degree": begun.color_degree, "finished": [v.record() for v in finished]},
    }
    return Checkpoint({**fitted, **shown, **{f"run.{name}": t for name, t in run.items()}}, record)


@pytest.mark.slow
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_run_that_an_earlier_version_began_ends_alike(
    catalog: Catalog, undisturbed: Path, tmp_path: Path, moment: str
) -> None:
    interrupt(MOMENTS[moment], QUICK, catalog, tmp_path)
    kept = Checkpoint.load(tmp_path)
    assert kept is not None
    assert part_of(kept.tensors, "fitted")
    as_before(kept, catalog).save(tmp_path)
    training = train(QUICK, catalog, tmp_path).training
    assert training["seconds"] > 0
    assert training["processor_seconds"] is None  # nobody kept those before
    assert outcome(tmp_path) == outcome(undisturbed)
