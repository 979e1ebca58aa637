"""Training from a catalog: stages 1, 2 and 3, checkpointed so that it can be stopped at any moment.

A run that was killed and resumed ends bit for bit where an undisturbed one does (on the same machine).  Every random choice is a
function of the seed and the step, and a checkpoint holds everything else.  The kernels give the same result for any number of
threads; torch, whose share of a step is small, runs on one.

Several processes may train together (`surrogate.training.ranks`).  The first of them reads and writes the run's folder; with the
same batch, any number of processes goes on with what another number began.
"""

from __future__ import annotations

import os
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import torch

from catalogs.files import durable
from catalogs.store.catalog import Catalog
from surrogate.model import FieldModel, Surrogate
from surrogate.model.judged import LEARNT
from surrogate.provenance import code, commit
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.splatting.cuda import chosen_device
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage import models
from surrogate.storage.checkpoints import CHECKPOINT, Checkpoint, fingerprint, locked
from surrogate.training.data import TrainingData
from surrogate.training.emulator import with_choices, with_emulator
from surrogate.training.ranks import ALONE, Ranks, require_own_gpu
from surrogate.training.session import Interruption, ProgressReport, TrainingSession
from surrogate.training.source import Source
from surrogate.training.stages import new_deformation
from surrogate.training.state import FittedGaussians, TrainingState
from surrogate.training.steps import plan


def train(
    settings: TrainingSettings,
    catalog: Catalog,
    directory: str | os.PathLike[str],
    *,
    progress: ProgressReport = lambda _: None,
    ranks: Ranks = ALONE,
    only_field: bool = False,
) -> Surrogate:
    """Fit a surrogate to the training images of `catalog` and keep it in `directory`.

    Where the catalog keeps coarse fields, their emulator is fitted first (`surrogate.training.emulator`), which takes
    seconds; with `only_field` that is all.  Both are then compared on validation images.

    A finished run is loaded and nothing is done; an interrupted one goes on from its last checkpoint.  SIGINT and
    SIGTERM write a checkpoint first and then act as ever.  Where several processes train together, each calls this with its
    `ranks`, and gets the same surrogate.

    Raises ValueError where `directory` holds a run of other settings or another catalog (nothing is overwritten), the catalog has
    nothing to learn from, or training diverges.  Raises RuntimeError where another process is training there, or one of `ranks` is
    lost or unlike the first.

    Examples
    --------
    >>> from blobs import CAMERA, make_run
    >>> from catalogs import Catalog
    >>> from surrogate import TrainingSettings, train
    >>> settings = TrainingSettings(gaussians=50, canonical_steps=2, deformation_steps=2)  # far too few
    >>> surrogate = train(settings, Catalog.open(make_run() / "blobs.cdb"), "few")
    >>> surrogate.at(separation=0.83, width=0.27).render(CAMERA).shape
    (128, 128, 4)
    """
    directory = Path(directory)
    source = Source(settings, catalog, ranks)
    mark = fingerprint(settings, catalog)
    _require_like_the_first(ranks, mark)
    ranks.by_first(lambda: with_emulator(source, directory, mark, required=only_field))
    if only_field or ranks.by_first(lambda: models.exists(directory)):
        return _finished(directory, mark, source, ranks)
    with ExitStack() as locks, one_torch_thread():
        is_finished, checkpoint = ranks.by_first(lambda: _claimed(directory, mark, locks))
        if is_finished:  # by another process, just now
            return _finished(directory, mark, source, ranks)
        session = TrainingSession(settings, directory, mark, _steps(source), progress, Interruption(), ranks=ranks)
        surrogate = _trained(source, checkpoint, session)
        ranks.by_first(lambda: _keep(surrogate, directory))
        session.interruption.act()  # what was asked for during the last choices
    return _finished(directory, mark, source, ranks)


def _claimed(directory: Path, mark: str, locks: ExitStack) -> tuple[bool, Checkpoint | None]:
    """Lock the folder as long as `held`; whether its surrogate is finished, else the checkpoint there."""
    durable.make_folder(directory)
    locks.enter_context(locked(directory))
    if models.exists(directory):
        return True, None
    checkpoint = Checkpoint.load(directory)
    if checkpoint is not None:
        _check_mark(checkpoint.record["fingerprint"], mark, directory)
    return False, checkpoint


def _keep(surrogate: Surrogate, directory: Path) -> None:
    surrogate.save(directory)
    (directory / CHECKPOINT).unlink(missing_ok=True)


def _require_like_the_first(ranks: Ranks, mark: str) -> None:
    """Raise RuntimeError where a process has other settings, another catalog or another version than the first."""
    if ranks.count > 1:
        first = ranks.agreed((mark, code(), torch.__version__))
        same = first == (mark, code(), torch.__version__)
        wrong = (
            f"process {ranks.rank} has other settings, another catalog, or another version of this project or of torch"
        )
        ranks.raise_any(None if same else RuntimeError(f"{wrong} than the first one: let all have the same"))


def _trained(source: Source, checkpoint: Checkpoint | None, session: TrainingSession) -> Surrogate:
    """The surrogate after all remaining steps."""
    session.report("loading", 0)
    data = source.data()
    field = FieldModel.load(session.directory) if FieldModel.exists(session.directory) else None
    steps = plan(source, data, field)
    field = field and field.learning(source.catalog, LEARNT)  # validation members choose while Gaussians are trained
    state = _begun(source, data, checkpoint, field)
    session.before, session.processor_before = state.seconds, state.processor_seconds
    with session.interruption:
        for step in steps[state.done :]:
            state = step(_same(state, session), session)
            state = replace(state, done=state.done + 1)
    state = state.to(torch.device("cpu"))
    catalog = source.catalog.plan
    return Surrogate(
        gaussians=state.fitted.gaussians,
        deformation=state.fitted.deformation,
        space=source.space,
        normalization=source.normalization,
        rasterizer=Rasterizer.of(source.settings).for_any_device(),
        background=catalog.background,
        training={
            "fingerprint": session.fingerprint,
            "appearance": source.appearance,
            "seconds": session.seconds,
            "processor_seconds": session.processor_seconds(),
            "commit": commit(),
            "code_version": code(),
            "steps": state.steps_before + _steps(source),
            "settings": source.settings.to_json(),
            "curve": list(state.curve),
            "choices": list(state.choices),
        },
        encodings=state.encodings,
        visualizations=state.visualizations,
        field=field,
    )


def _begun(
    source: Source, data: TrainingData, checkpoint: Checkpoint | None, field: FieldModel | None
) -> TrainingState:
    """The state that training goes on from."""
    device = chosen_device(source.settings.device)
    require_own_gpu(source.ranks, device)
    if checkpoint is not None:
        return TrainingState.load(checkpoint).to(device)
    start = None if field is None else source.start_from_field(field)
    gaussians = source.initial_gaussians(data) if start is None else start.gaussians
    deformation = new_deformation(gaussians, len(source.catalog.plan.space), source.settings)
    if start is not None:
        deformation = replace(deformation, emulated=start.emulated)
    return TrainingState(FittedGaussians(gaussians, deformation).to(device))


def _same(state: TrainingState, session: TrainingSession) -> TrainingState:
    """The first process's state: other processors may have come to others in what each computes by itself."""
    ranks = session.ranks
    if ranks.count == 1:
        return state
    device = state.fitted.gaussians.means.device
    checkpoint = ranks.by_first(lambda: state.checkpoint(session.fingerprint).in_main_memory())
    return state if ranks.is_first else TrainingState.load(checkpoint).to(device)


def _steps(source: Source) -> int:
    """Of all stages."""
    settings = source.settings
    of_variations = len(source.variations) * settings.visualization_steps
    return settings.canonical_steps + settings.deformation_steps + of_variations


def _finished(directory: Path, mark: str, source: Source, ranks: Ranks) -> Surrogate:
    """The surrogate in `directory`, after the choices that its representations leave."""
    finished = Surrogate.load(directory)
    _check_mark(finished.training.get("fingerprint"), mark, directory)
    return ranks.by_first(lambda: with_choices(finished, source.catalog, directory))


def _check_mark(previous: str | None, mark: str, directory: Path) -> None:
    if previous != mark:
        raise ValueError(
            f"{directory} holds a run with other training settings or of another catalog, and nothing is overwritten: "
            "delete or rename that folder, or train into another one"
        )
