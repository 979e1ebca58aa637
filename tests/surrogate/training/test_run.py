import json
import signal
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.tools.packing import pack
from surrogate import Surrogate, TrainingSettings, train
from surrogate.splatting import cpu, cuda
from surrogate.storage.checkpoints import Checkpoint, fingerprint
from surrogate.training.compression.choice import Choice
from surrogate.training.session import TrainingProgress
from tests.support.blobs import Blobs
from tests.support.interruptions import files, interrupt, kill_again_and_again, outcome
from tests.support.prepared import Program

QUICK = TrainingSettings(
    gaussians=60, canonical_steps=15, deformation_steps=25, validation_interval=10, relocation_interval=5
)


def decibels(surrogate: Surrogate, blobs: Blobs, p: float) -> float:
    """Mean PSNR on white over views that no member was seen from."""
    scores = []
    for camera in blobs.cameras(2)[12::5]:
        truth, picture = blobs.picture(p, camera), surrogate.at(p=p).render(camera)
        on_white = [image[..., :3] + 1.0 - image[..., 3:] for image in (truth, picture)]
        scores.append(-10.0 * np.log10(np.mean((on_white[0] - on_white[1].clip(0, 1)) ** 2)))
    return float(np.mean(scores))


@pytest.mark.slow
def test_unseen_parameters_and_views_are_recovered(make_catalog, tmp_path: Path) -> None:
    blobs = Blobs()
    members = [("train", p) for p in (0.0, 0.25, 0.5, 0.75, 1.0)] + [("validation", 0.6)]
    catalog = make_catalog(blobs, members=members, view_splits=("train",) * 12)
    settings = TrainingSettings(gaussians=150, canonical_steps=400, deformation_steps=1200)
    surrogate = train(settings, catalog, tmp_path / "surrogate")
    canonical = Surrogate.load(tmp_path / "surrogate").training["curve"][0]
    assert decibels(surrogate, blobs, 0.4) > 28.0
    assert surrogate.training["curve"][-1]["psnr"] > canonical["psnr"] + 4.0


@pytest.mark.slow
def test_a_finished_run_has_nothing_to_do(make_catalog, tmp_path: Path) -> None:
    catalog, seen = make_catalog(), []
    first = train(QUICK, catalog, tmp_path / "surrogate")
    before = contents(tmp_path / "surrogate")
    again = train(QUICK, catalog, tmp_path / "surrogate", progress=seen.append)
    assert seen == []
    assert contents(tmp_path / "surrogate") == before
    assert again.training["curve"] == first.training["curve"]


@pytest.mark.slow
def test_a_packed_catalog_gives_the_same_surrogate(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog()
    pack(catalog.path, tmp_path / "packed.cdb")
    packed = Catalog.open(tmp_path / "packed.cdb")
    assert fingerprint(QUICK, packed) == fingerprint(QUICK, catalog)
    train(QUICK, catalog, tmp_path / "surrogate")
    train(QUICK, packed, tmp_path / "again")
    assert outcome(tmp_path / "again") == outcome(tmp_path / "surrogate")


def test_what_another_process_finished_meanwhile_is_taken(
    make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It let go of the lock between the look at the folder and the lock on it."""
    catalog, seen = make_catalog(), []
    train(QUICK, catalog, tmp_path / "surrogate")
    before = contents(tmp_path / "surrogate")
    looks = iter([False])
    monkeypatch.setattr(Surrogate, "exists", staticmethod(lambda directory: next(looks, True)))
    train(QUICK, catalog, tmp_path / "surrogate", progress=seen.append)
    assert seen == []
    assert contents(tmp_path / "surrogate") == before


def test_progress_says_where_training_stands(make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("surrogate.training.session.REPORT_SECONDS", 0.0)
    seen: list[TrainingProgress] = []
    catalog = make_catalog(members=(("train", 0.0), ("train", 1.0), ("validation", 0.5)))
    train(QUICK, catalog, tmp_path / "surrogate", progress=seen.append)
    steps = [progress.step for progress in seen if progress.stage != "compression"]
    assert steps == sorted(steps)
    assert [(p.step, p.steps) for p in seen if p.stage == "compression"] == [(done, 5) for done in range(5)]
    assert {progress.stage for progress in seen} == {
        "loading",
        "canonical",
        "colour degree",
        "deformation",
        "compression",
    }
    last = [progress for progress in seen if progress.stage == "deformation"][-1]
    assert last.step == last.steps == 40
    assert last.rate > 0
    assert last.seconds_left == 0
    assert last.psnr is not None
    assert "40 / 40" in str(last)
    assert "steps/s" in str(last)


@pytest.mark.parametrize("finished", [True, False])
def test_other_settings_or_data_are_refused_and_nothing_changes(make_catalog, tmp_path: Path, finished: bool) -> None:
    catalog, folder = make_catalog(), tmp_path / "surrogate"
    if finished:
        train(QUICK, catalog, folder)
    else:
        interrupt_after(20, QUICK, catalog, folder)
    before = contents(folder)
    other = make_catalog(members=(("train", 0.0), ("train", 0.9)), name="other.cdb")
    for settings, data in ((TrainingSettings(gaussians=61), catalog), (QUICK, other)):
        with pytest.raises(ValueError, match="delete or rename that folder"):
            train(settings, data, folder)
    assert contents(folder) == before


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        {"members": (("train", 0.5),)},
        {"members": (("train", 0.5),), "view_splits": ("train",)},
        {"blank": True},
        {"background": (1.0, 1.0, 1.0)},
        {"background": (0.2, 0.0, 0.4), "blank": True},
    ],
    ids=["one member", "one view of one member", "empty images", "opaque images", "opaque empty images"],
)
@pytest.mark.parametrize("color_degree", [0, 1])
def test_the_smallest_ensembles_train(make_catalog, tmp_path: Path, case: dict, color_degree: int) -> None:
    catalog = make_catalog(**case)
    settings = TrainingSettings.from_table(QUICK.to_json() | {"color_degree": color_degree})
    surrogate = train(settings, catalog, tmp_path / "surrogate")
    picture = surrogate.at(p=0.5).render(catalog.members[0].cameras[0])
    assert np.isfinite(picture).all()
    assert np.isfinite([point["loss"] for point in surrogate.training["curve"]]).all()


def test_an_ensemble_without_a_deformation_stage_is_static(make_catalog, tmp_path: Path) -> None:
    settings = TrainingSettings.from_table(QUICK.to_json() | {"deformation_steps": 0})
    surrogate = train(settings, make_catalog(), tmp_path / "surrogate")
    camera = Blobs().cameras()[0]
    np.testing.assert_array_equal(surrogate.at(p=0.0).render(camera), surrogate.at(p=1.0).render(camera))


def test_a_constant_parameter_does_no_harm(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog(members=(("train", 0.5), ("validation", 0.5001)))
    surrogate = train(QUICK, catalog, tmp_path / "surrogate")
    assert np.isfinite(surrogate.at(p=0.0).means).all()


def test_a_world_far_from_the_origin_is_learnt_alike(make_catalog, tmp_path: Path) -> None:
    near = make_catalog(Blobs(), name="near.cdb")
    far = make_catalog(Blobs(origin=(1e6, -2e6, 3e5), unit=50.0), name="far.cdb")
    a, b = (train(QUICK, c, tmp_path / n) for c, n in ((near, "a"), (far, "b")))
    assert a.training["curve"][-1]["loss"] == pytest.approx(b.training["curve"][-1]["loss"], rel=0.02)
    np.testing.assert_allclose(b.at(p=0.5).means.mean(0), [1e6, -2e6, 3e5], atol=25.0)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"appearance": "isosurface"}, r"must be one of the catalog's drawn, got 'isosurface'"),
        ({"initialization": "in-situ"}, "no training member of this catalog has sampled points"),
    ],
)
def test_what_the_catalog_lacks_is_named(make_catalog, tmp_path: Path, settings: dict, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        train(TrainingSettings.from_table(settings), make_catalog(), tmp_path / "surrogate")


def test_a_catalog_without_training_images_changes_nothing(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog(members=(("test", 0.5),))
    with pytest.raises(ValueError, match="holds no training images"):
        train(QUICK, catalog, tmp_path / "surrogate")
    assert not (tmp_path / "surrogate").exists()


@pytest.mark.slow
def test_two_processes_never_train_in_one_folder(make_catalog, tmp_path: Path) -> None:
    catalog, folder = make_catalog(), tmp_path / "surrogate"
    long = TrainingSettings.from_table(QUICK.to_json() | {"deformation_steps": 100_000})
    process = start(long, catalog, folder)
    try:
        process.stdout.readline()
        with pytest.raises(RuntimeError, match="another process is training"):
            train(long, catalog, folder)
    finally:
        process.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, -signal.SIGINT), (signal.SIGTERM, 128 + signal.SIGTERM)]
)
def test_an_interrupted_run_goes_on_where_it_stopped(make_catalog, tmp_path: Path, number: int, status: int) -> None:
    catalog, folder = make_catalog(), tmp_path / "surrogate"
    settings = TrainingSettings.from_table(QUICK.to_json() | {"deformation_steps": 300, "checkpoint_seconds": 1e6})
    process = start(settings, catalog, folder)
    try:
        process.stdout.readline()
        process.send_signal(number)
        assert process.wait(timeout=60) == status, process.stderr.read()
    finally:
        process.close()
    assert (folder / "checkpoint.safetensors").exists()
    before = Checkpoint.load(folder).record
    resumed = train(settings, catalog, folder)
    train(settings, catalog, tmp_path / "undisturbed")
    assert outcome(folder) == outcome(tmp_path / "undisturbed")
    assert resumed.training["seconds"] > 0
    assert resumed.training["processor_seconds"] > before["processor_seconds"] > 0
    assert files(folder) == ["model.json", "model.safetensors"]


@pytest.mark.slow
def test_a_run_killed_again_and_again_ends_where_an_undisturbed_one_does(make_catalog, tmp_path: Path) -> None:
    catalog, folder = make_catalog(), tmp_path / "surrogate"
    settings = TrainingSettings(
        **QUICK.to_json() | {"canonical_steps": 60, "deformation_steps": 90, "checkpoint_seconds": 1e-4}
    )
    assert kill_again_and_again(settings, catalog, folder) >= 5
    train(settings, catalog, folder)
    train(settings, catalog, tmp_path / "undisturbed")
    assert outcome(folder) == outcome(tmp_path / "undisturbed")
    assert files(folder) == ["model.json", "model.safetensors"]


@pytest.mark.slow
@pytest.mark.parametrize("step", [10, 18, 30])
def test_a_run_whose_colours_turn_out_to_depend_on_the_direction_goes_on_alike(
    make_catalog, tmp_path: Path, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def choose(*_: object) -> tuple[int, Choice]:
        asked.append(True)
        return 1, Choice("colour degree", "1")

    monkeypatch.setattr("surrogate.training.steps.choose_color_degree", choose)
    catalog = make_catalog()
    interrupt_after(step, QUICK, catalog, tmp_path / "resumed")
    resumed = train(QUICK, catalog, tmp_path / "resumed")
    assert len(asked) == 1
    train(QUICK, catalog, tmp_path / "undisturbed")
    assert outcome(tmp_path / "resumed") == outcome(tmp_path / "undisturbed")
    assert resumed.gaussians.color_degree == 1
    assert [choice["name"] for choice in resumed.training["choices"]][:2] == ["colour degree", "steps at low rates"]


def test_nothing_is_chosen_without_validation_images_or_where_it_is_not_wanted(make_catalog, tmp_path: Path) -> None:
    without = train(QUICK, make_catalog(view_splits=("train",) * 4), tmp_path / "without")
    plain = TrainingSettings.from_table(QUICK.to_json() | {"fit_to_need": False, "color_degree": 0})
    unwanted = train(plain, make_catalog(name="other.cdb"), tmp_path / "unwanted")
    for surrogate in (without, unwanted):
        assert surrogate.training["choices"] == []
        assert not surrogate.encodings
        assert len(surrogate.gaussians) == QUICK.gaussians
        assert surrogate.deformation.latent_size == QUICK.latent_size


def test_what_was_chosen_is_stored_and_read_again(make_catalog, tmp_path: Path) -> None:
    trained = train(QUICK, make_catalog(), tmp_path)
    loaded = Surrogate.load(tmp_path)
    names = ["colour degree", "steps at low rates", "attributes that deform", "modes of deformation", "Gaussians"]
    assert [choice["name"] for choice in loaded.training["choices"]] == [*names, "precision"]
    assert loaded.megabytes == trained.megabytes
    camera = Blobs().cameras()[3]
    np.testing.assert_array_equal(loaded.at(p=0.4).render(camera), trained.at(p=0.4).render(camera))


def test_what_was_trained_by_the_gpus_backend_is_drawn_without_one(
    make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cuda, "render", cpu.render)
    settings = TrainingSettings.from_table(
        QUICK.to_json() | {"backend": "cuda", "fit_to_need": False, "color_degree": 0}
    )
    train(settings, make_catalog(), tmp_path)
    monkeypatch.undo()
    picture = Surrogate.load(tmp_path).at(p=0.4).render(Blobs().cameras()[3])
    assert np.isfinite(picture).all()


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def start(settings: TrainingSettings, catalog: Catalog, folder: Path) -> Program:
    """Train in another process, which writes a line when its steps have begun."""
    program = (
        "import sys, json\n"
        "import surrogate.training.session\n"
        "from catalogs.store.catalog import Catalog\n"
        "from surrogate import TrainingSettings, train\n"
        "surrogate.training.session.REPORT_SECONDS = 0.01\n"
        "said = []\n"
        "def tell(progress):\n"
        "    if progress.stage != 'loading' and not said:\n"
        "        said.append(print('training', flush=True))\n"
        "settings = TrainingSettings(**json.loads(sys.argv[1]))\n"
        "train(settings, Catalog.open(sys.argv[2]), sys.argv[3], progress=tell)\n"
    )
    return Program(program, json.dumps(settings.to_json()), catalog.path, folder)


def interrupt_after(steps: int, settings: TrainingSettings, catalog: Catalog, folder: Path) -> None:
    """Train for a while in this process, then press Ctrl-C."""
    interrupt(lambda progress: progress.step >= steps, settings, catalog, folder)
