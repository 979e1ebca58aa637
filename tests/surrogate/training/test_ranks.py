"""Processes that train together end where one alone does, and end together whatever happens to one of them."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from catalogs.store.catalog import Catalog
from surrogate import Surrogate, TrainingSettings, train
from surrogate.cli import main
from surrogate.storage.checkpoints import Checkpoint
from surrogate.training.loop import StageRun
from surrogate.training.losses import image_loss
from surrogate.training.ranks import ALONE, Ranks
from surrogate.training.sampling import ShuffledEpochs
from surrogate.training.source import Source
from surrogate.training.stages import RATES, canonical_stage
from tests.support.blobs import Blobs
from tests.support.field_blobs import field_catalog
from tests.support.interruptions import files, interrupt, outcome
from tests.support.prepared import PROJECT, Program
from tests.support.ranks import LIMIT, outputs, require_gloo, started

SMALL = Blobs(count=4, size=16)
QUICK = TrainingSettings(
    gaussians=40, canonical_steps=12, deformation_steps=24, validation_interval=10, relocation_interval=5, batch=2
)
PLAIN = QUICK.changed(fit_to_need=False, color_degree=0)
TRAINING = """
import hashlib
import surrogate.training.session
from catalogs.store.catalog import Catalog
from surrogate import TrainingSettings, train
surrogate.training.session.REPORT_SECONDS = 0.01
said = []
def tell(progress):
    if progress.stage != "loading" and not said:
        said.append(print("training", flush=True))
settings = TrainingSettings.from_table(json.loads(sys.argv[1]))
with launched() as ranks:
    made = train(settings, Catalog.open(sys.argv[2]), sys.argv[3], progress=tell, ranks=ranks)
    tensors = made.gaussians.tensors() | made.deformation.tensors()
    print(hashlib.sha256(b"".join(tensors[name].detach().numpy().tobytes() for name in sorted(tensors))).hexdigest())
"""


@pytest.fixture
def catalog(make_catalog) -> Catalog:
    return make_catalog(SMALL, view_splits=("train",) * 5 + ("validation", "test"))


def trained_by_two(settings: TrainingSettings, catalog: Catalog, folder: Path) -> Surrogate:
    """Both hold the same numbers in the end, bit for bit."""
    first, second = outputs(TRAINING, json.dumps(settings.to_json()), catalog.path, folder)
    assert first.splitlines()[-1] == second.splitlines()[-1]
    return Surrogate.load(folder)


def begun_by_two(settings: TrainingSettings, catalog: Catalog, folder: Path):
    """Two that have begun to train."""
    return started(TRAINING, json.dumps(settings.to_json()), catalog.path, folder)


def wait_for_both(running: list[Program]) -> None:
    for process in running:
        assert process.stdout.readline() == "training\n", process.stderr.read()


def endless(settings: TrainingSettings = PLAIN) -> TrainingSettings:
    return settings.changed(deformation_steps=1_000_000, checkpoint_seconds=1e6)


@given(st.integers(1, 20), st.integers(0, 100))
def test_shares_are_all_items_once_and_as_equal_as_can_be(count: int, items: int) -> None:
    shares = [Ranks(rank, count).share(items) for rank in range(count)]
    assert [item for share in shares for item in share] == list(range(items))
    assert max(map(len, shares)) - min(map(len, shares)) <= 1


def test_alone_nobody_is_asked() -> None:
    assert ALONE.agreed("a") == "a"
    assert ALONE.gathered(3) == [3]
    assert ALONE.by_first(lambda: 5) == 5
    assert list(ALONE.share(4)) == [0, 1, 2, 3]


@pytest.mark.slow
def test_two_end_bit_for_bit_where_one_with_the_same_batch_does(catalog: Catalog, tmp_path: Path) -> None:
    settings = QUICK
    trained_by_two(settings, catalog, tmp_path / "two")
    train(settings, catalog, tmp_path / "one")
    assert outcome(tmp_path / "two") == outcome(tmp_path / "one")
    assert files(tmp_path / "two") == ["model.json", "model.safetensors"]


@pytest.mark.slow
@pytest.mark.parametrize("carried", ["colors", "values"])
def test_two_follow_visualization_parameters_as_one_does(tmp_path: Path, carried: str) -> None:
    members = (("train", 0.0), ("train", 1.0), ("validation", 0.4))
    views = ("train",) * 2 + ("validation",)
    catalog = field_catalog(tmp_path / "field.cdb", members=members, view_splits=views, summaries=True)
    small = {"visualization_steps": 10, "latent_size": 3, "hidden_width": 4}
    settings = QUICK.changed(carried=carried, canonical_steps=6, deformation_steps=8, **small)
    trained_by_two(settings, catalog, tmp_path / "two")
    train(settings, catalog, tmp_path / "one")
    assert outcome(tmp_path / "two") == outcome(tmp_path / "one")


@pytest.mark.slow
def test_larger_batches_differ_by_the_order_of_their_sums_alone(catalog: Catalog, tmp_path: Path) -> None:
    settings = PLAIN.changed(batch=5, deformation_steps=8)  # Adam magnifies rounding where gradients nearly cancel
    two = trained_by_two(settings, catalog, tmp_path / "two")
    one = train(settings, catalog, tmp_path / "one")
    for camera in Blobs().cameras()[:2]:
        pictures = [surrogate.at(p=0.4).render(camera) for surrogate in (one, two)]
        np.testing.assert_allclose(*pictures, atol=1e-3)
    assert two.training["curve"][-1]["loss"] == pytest.approx(one.training["curve"][-1]["loss"], rel=1e-4)


@pytest.mark.slow
def test_two_go_on_with_what_one_began_and_one_with_what_two_began(catalog: Catalog, tmp_path: Path) -> None:
    settings = PLAIN.changed(deformation_steps=200, checkpoint_seconds=1e6)
    train(settings, catalog, tmp_path / "undisturbed")
    interrupt(lambda progress: progress.step >= 20, settings, catalog, tmp_path / "one first")
    trained_by_two(settings, catalog, tmp_path / "one first")
    with begun_by_two(settings, catalog, tmp_path / "two first") as running:
        wait_for_both(running)
        running[0].send_signal(signal.SIGTERM)
        assert [process.wait(LIMIT) for process in running] == [128 + signal.SIGTERM] * 2
    assert 0 < Checkpoint.load(tmp_path / "two first").record["step"] < 200
    train(settings, catalog, tmp_path / "two first")
    for folder in ("one first", "two first"):
        assert outcome(tmp_path / folder) == outcome(tmp_path / "undisturbed")


@pytest.mark.slow
def test_who_presses_ctrl_c_in_one_stops_all_after_a_checkpoint(catalog: Catalog, tmp_path: Path) -> None:
    with begun_by_two(endless(), catalog, tmp_path / "run") as running:
        wait_for_both(running)
        running[1].send_signal(signal.SIGINT)
        assert [process.wait(LIMIT) for process in running] == [-signal.SIGINT] * 2
    assert Checkpoint.load(tmp_path / "run") is not None


@pytest.mark.slow
def test_who_loses_another_says_so_and_leaves_no_model(catalog: Catalog, tmp_path: Path) -> None:
    with begun_by_two(endless().changed(checkpoint_seconds=1e-3), catalog, tmp_path / "run") as running:
        wait_for_both(running)
        while not (tmp_path / "run" / "checkpoint.safetensors").exists() and running[0].returncode is None:
            time.sleep(0.01)
        running[1].kill()
        _, errors = running[0].communicate(LIMIT)
        assert running[0].wait() == 1
    assert "ProcessLost: a process of this training ended or does not answer" in errors
    assert files(tmp_path / "run") == ["checkpoint.safetensors"]
    assert Checkpoint.load(tmp_path / "run").record["step"] > 0


@pytest.mark.slow
def test_other_numbers_in_one_process_are_never_kept(catalog: Catalog, tmp_path: Path) -> None:
    unlike = TRAINING.replace(
        "settings =",
        "from surrogate.training.loop import StageRun\n"
        "advance = StageRun.advance\n"
        "def spoilt(run, pause):\n"
        "    loss = advance(run, pause)\n"
        "    if os.environ['RANK'] == '1' and run.step == 6:\n"
        "        run.stage.tensors['means'].data[3, 1] += 1e-6\n"
        "    return loss\n"
        "StageRun.advance = spoilt\n"
        "settings =",
        1,
    )
    settings = endless().changed(checkpoint_seconds=1e-9)
    with started(unlike, json.dumps(settings.to_json()), catalog.path, tmp_path / "run") as running:
        told = [process.communicate(LIMIT)[1] for process in running]
        assert [process.wait() for process in running] == [1, 0]
    assert "process 1 of this training came to other numbers than the first one" in told[0]
    assert Checkpoint.load(tmp_path / "run").record["step"] == 5


@pytest.mark.slow
def test_what_diverges_in_one_process_has_diverged_in_all(catalog: Catalog, tmp_path: Path) -> None:
    failing = TRAINING.replace(
        "settings =",
        "from surrogate.training.loop import StageRun, Diverged\n"
        "drawn = StageRun._render\n"
        "def spoilt(run, *drawing):\n"
        "    if os.environ['RANK'] == '1' and run.step == 6:\n"
        "        raise Diverged('training diverged here')\n"
        "    return drawn(run, *drawing)\n"
        "StageRun._render = spoilt\n"
        "settings =",
        1,
    )
    with started(failing, json.dumps(PLAIN.to_json()), catalog.path, tmp_path / "run") as running:
        told = [process.communicate(LIMIT)[1] for process in running]
        assert [process.wait() for process in running] == [1, 1]
    assert all("Diverged: training diverged here" in errors for errors in told)
    assert files(tmp_path / "run") == []


@pytest.mark.slow
def test_another_catalog_in_one_process_is_refused(make_catalog, tmp_path: Path) -> None:
    catalog, other = (
        make_catalog(SMALL, name=name, members=(("train", p),)) for name, p in (("a.cdb", 0.1), ("b.cdb", 0.2))
    )
    choosing = TRAINING.replace("Catalog.open(sys.argv[2])", "Catalog.open(sys.argv[2 + 2 * int(os.environ['RANK'])])")
    with started(choosing, json.dumps(PLAIN.to_json()), catalog.path, tmp_path / "run", other.path) as running:
        told = [process.communicate(LIMIT)[1] for process in running]
        assert [process.wait() for process in running] == [0, 1]
    assert "process 1 has other settings, another catalog" in told[1]
    assert not (tmp_path / "run").exists()


BUDGETED = """
import time
import surrogate.training.budget as budget
import surrogate.training.pace as pace
from catalogs.store.catalog import Catalog
from surrogate.training.begin import TrainingOptions, begin
budget.LEAST_SECONDS = pace.LEAST_SECONDS = 0.01
budget.SPARE = 0.0
begun = time.perf_counter()
with launched() as ranks:
    elapsed = lambda: time.perf_counter() - begun + ranks.rank
    asked = TrainingOptions(budget.Budget(minutes=0.25), settings={"batch": 2})
    run = begin(Catalog.open(sys.argv[1]).path, __import__("pathlib").Path(sys.argv[2]), asked, elapsed=elapsed, ranks=ranks)
    print(json.dumps([run.settings.to_json(), run.record.chosen, run.record.made]))
"""


@pytest.mark.slow
def test_a_budget_in_minutes_leads_all_to_the_same_settings(catalog: Catalog, tmp_path: Path) -> None:
    first, second = outputs(BUDGETED, catalog.path, tmp_path / "run")
    assert first == second
    settings, chosen, _ = json.loads(first)
    assert chosen["steps"] == settings["canonical_steps"] + settings["deformation_steps"]
    assert json.loads((tmp_path / "run" / "run.json").read_text())["settings"] == settings


@pytest.mark.slow(seconds=10)
def test_torchrun_trains_from_the_command_line_and_tells_once(catalog: Catalog, tmp_path: Path) -> None:
    require_gloo()
    asked = ["train", str(catalog.path), "--steps", "30", "-o", str(tmp_path / "run"), "gaussians=30", "batch=2"]
    together = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", "-m", "surrogate", *asked]
    made = subprocess.run([sys.executable, *together], cwd=PROJECT, capture_output=True, text=True, timeout=LIMIT)
    assert made.returncode == 0, made.stderr
    assert made.stdout.count("next: surrogate explore") == 1
    assert "nothing to do" in CliRunner().invoke(main, asked, catch_exceptions=False).output


def test_fewer_images_than_processes_are_refused_with_the_remedy(catalog: Catalog) -> None:
    with pytest.raises(ValueError, match=r"3 processes can't share steps of batch = 2 pictures: say batch = 3 or more"):
        Source(QUICK, catalog, Ranks(1, 3))


@pytest.mark.parametrize("batch", [1, 4])
def test_a_batch_moves_by_the_mean_of_its_gradients_at_the_rate_times_its_root(catalog: Catalog, batch: int) -> None:
    """Adam's first step is the rate in the direction of the gradient, however long that is."""
    settings = PLAIN.changed(batch=batch)
    source = Source(settings, catalog)
    data = source.data()
    run = StageRun(canonical_stage(source.initial_gaussians(data), settings), settings, data)
    colors = run.stage.tensors["colors"]
    before = colors.detach().clone()
    told = run.advance()
    again = StageRun(
        canonical_stage(source.initial_gaussians(data), settings.changed(batch=1)), PLAIN.changed(batch=1), data
    )
    gradients = []
    for item in [ShuffledEpochs(len(data.examples), settings.seed)[place] for place in range(batch)]:
        example = data.examples[item]
        picture = again._render(again.stage.gaussians_at(example.parameters), example)
        loss = image_loss(picture, torch.from_numpy(example.compared()))
        loss.backward()
        gradients.append((float(loss.detach()), again.stage.tensors["colors"].grad.clone()))
        again.stage.tensors["colors"].grad = None
    assert told == pytest.approx(np.mean([loss for loss, _ in gradients]))
    sure = sum(gradient for _, gradient in gradients)
    moved = (before - colors.detach())[sure.abs() > 1e-6]
    assert len(moved) > 20
    expected = batch**0.5 * RATES["colors"] * sure[sure.abs() > 1e-6].sign()
    torch.testing.assert_close(moved, expected, rtol=1e-3, atol=1e-7)
