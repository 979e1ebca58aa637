"""Every method in every time with every seed: what is missing is made, kept at once, and shared out."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from catalogs.files import durable
from research.studies.baselines.method import Plan
from research.studies.comparison.contestants import OurSurrogate, Published, curve_of, precision_here
from research.studies.comparison.fitting import OutOfTime
from research.studies.comparison.pictures import TRUTH, path_of, shown_cases, stored_images
from research.studies.comparison.result import AS_PUBLISHED, TRIVIAL, ComparisonResult, find, in_float32, load, save
from research.studies.comparison.study import FITS, scored
from research.studies.comparison.task import ComparisonTask
from surrogate.provenance import commit
from surrogate.storage.checkpoints import locked
from tests.research.support.comparisons import MEMBERS, SECOND, SMALL, VIEWS, study
from tests.research.support.mean_pictures import mean_method
from tests.support.varied_blobs import varied_catalog, varied_surrogate

TRIALS = 2  # of a few steps, which say how many fit


def test_what_is_missing_is_made_once(task: ComparisonTask, tmp_path: Path) -> None:
    told: list[ComparisonResult] = []
    both = Published(mean_method("one")), Published(mean_method("two"))
    study(task, tmp_path, *both, seeds=2).run(tell=told.append)
    assert [(r.method, r.seed) for r in told] == [(TRIVIAL, 0), ("one", 0), ("two", 0), ("one", 1), ("two", 1)]
    for result in told[1:]:
        assert not result.error
        assert result.steps >= 1
        assert set(result.cells) == set(task.cells)
        assert result.cells["both"]["images"] == len(task.cells["both"])
        assert 0.0 < result.cells["both"]["psnr"] < 60.0
        assert result.curve[-1][0] == pytest.approx(result.seconds, abs=0.05)
        assert result.megabytes == pytest.approx(16 * 16 * 4 * 4 / 1e6)
        assert result.provenance.commit == commit()
    told.clear()
    study(task, tmp_path, *both, seeds=2).run(tell=told.append)
    assert told == []
    assert len(load(tmp_path / "records" / "blobs")) == 5


def test_pictures_of_another_processor_are_the_same_and_others_are_not(
    task: ComparisonTask, make_catalog, tmp_path: Path
) -> None:
    made = study(task, tmp_path)
    made.run()
    [mixed] = [result for result in load(made.records) if result.method == TRIVIAL]
    assert set(mixed.colors) == set(made.task.cells)
    for change, is_same in ((5e-5, True), (5e-4, False)):
        colors = {cell: [value + change for value in color] for cell, color in mixed.colors.items()}
        save(made.records, replace(mixed, colors=colors))
        if is_same:
            made.run(tell=pytest.fail)
        else:
            with pytest.raises(ValueError, match=r"belong to other images than .*: the mean color of .* was .* and is"):
                made.run()
    save(made.records, mixed)
    blank = ComparisonTask.of(make_catalog(SMALL, members=MEMBERS, view_splits=VIEWS, blank=True, name="blank.cdb"))
    with pytest.raises(
        ValueError, match=r"belong to other images than .*blank\.cdb: .* or keep results elsewhere with"
    ):
        study(blank, tmp_path).run()


def test_published_methods_train_on_as_many_threads_as_are_asked_for(task: ComparisonTask, tmp_path: Path) -> None:
    seen = list[int]()

    def loss(_: int) -> float:
        seen.append(torch.get_num_threads())
        return 0.5

    made = study(task, tmp_path, Published(mean_method(loss=loss)), plan=Plan(1, threads=2))
    made.run()
    assert set(seen) == {2}
    found = find(made.records, made.wanted("mean", SECOND, 0))
    assert found is not None
    assert found.threads == 2


def test_scores_are_those_of_the_pictures(task: ComparisonTask, tmp_path: Path) -> None:
    """The mean of all pictures, scored by hand."""
    from surrogate.evaluation.metrics import score

    made = study(task, tmp_path)
    made.run()
    [result] = [r for r in load(made.records) if r.method == "mean"]
    pixels = task.pictures().pixels
    order = [i % len(pixels) for i in range(result.steps)]
    mean = (pixels[order] / 255.0).mean(axis=0).astype("float32")
    catalog = task.catalog
    expected = [
        score(catalog.image(c.member, c.appearance, c.view), mean, catalog.plan.background).psnr
        for c in task.cells["both"]
    ]
    assert result.cells["both"]["psnr"] == pytest.approx(sum(expected) / len(expected), abs=1e-3)


def test_a_failure_is_kept_and_leaves_the_others(task: ComparisonTask, tmp_path: Path) -> None:
    told: list[ComparisonResult] = []
    broken = Published(mean_method("broken", loss=lambda _: math.nan))
    study(task, tmp_path, broken, Published(mean_method())).run(tell=told.append)
    assert [(r.method, bool(r.error)) for r in told[1:]] == [("broken", True), ("mean", False)]
    assert "The mean diverged" in told[1].error
    mended = study(task, tmp_path, Published(mean_method("broken")))
    mended.run()
    found = find(mended.records, mended.wanted("broken", SECOND, 0))
    assert found is not None
    assert not found.error


def narrow_machine(monkeypatch: pytest.MonkeyPatch, **capabilities: bool) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: capabilities, raising=False)


def test_networks_are_narrow_where_the_machine_multiplies_so(monkeypatch: pytest.MonkeyPatch) -> None:
    narrow_machine(monkeypatch, avx512_f=True)
    assert precision_here("bfloat16", "cpu") == "float32"
    assert precision_here("bfloat16", "cuda") == "bfloat16"
    narrow_machine(monkeypatch, avx512_bf16=True)
    assert [precision_here(p, "cpu") for p in ("bfloat16", "float32")] == ["bfloat16", "float32"]
    monkeypatch.delattr(torch.cpu, "get_capabilities")
    assert precision_here("bfloat16", "cpu") == "float32"


def test_each_precision_has_results_of_its_own(
    task: ComparisonTask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    narrow_machine(monkeypatch, amx_bf16=True)
    both = study(task, tmp_path, Published(mean_method(), "bfloat16"))
    both.run()
    narrow_machine(monkeypatch)
    both.run()
    both.run(tell=pytest.fail)
    found = [r for r in load(both.records) if r.method == "mean"]
    assert [r.precision for r in found] == ["bfloat16", "float32"]
    assert [r.precision for r in in_float32(found)] == ["float32"]
    assert in_float32(found[:1]) == found[:1]


def test_what_another_process_trains_is_left_to_it(task: ComparisonTask, tmp_path: Path) -> None:
    made, told = study(task, tmp_path), list[ComparisonResult]()
    folder = made.folder / FITS / made.wanted("mean", SECOND, 0).name
    durable.make_folder(folder)
    with locked(folder):
        made.run(tell=told.append)
    assert [r.method for r in told] == [TRIVIAL]
    made.run(tell=told.append)
    assert [r.method for r in told] == [TRIVIAL, "mean"]


def test_another_size_or_catalog_is_another_result(task: ComparisonTask, tmp_path: Path) -> None:
    made = study(task, tmp_path)
    made.run()
    wanted = made.wanted("mean", SECOND, 0)
    assert find(made.records, wanted) is not None
    for other in (
        replace(wanted, mark="of another catalog"),
        replace(wanted, size="small"),
        replace(wanted, precision="bfloat16"),
        replace(wanted, seed=1),
        replace(wanted, minutes=2.0),
        replace(wanted, device="cuda"),
    ):
        assert find(made.records, other) is None


def test_pictures_of_the_same_images_are_kept(task: ComparisonTask, tmp_path: Path) -> None:
    made = study(task, tmp_path)
    made.run()
    path_of(made.records, TRUTH, 0).unlink()
    made.run()  # of records without it, such as those of an earlier version
    drawn = stored_images(made.records, made.wanted("mean", SECOND, 0).name)
    for number, case in enumerate(shown_cases(task)):
        assert case.member.split == "test"
        truth = 255.0 * stored_images(made.records, TRUTH)[number]
        rgba = task.catalog.image(case.member, case.appearance, case.view).astype(float)
        expected = rgba[..., :3] + (255.0 - rgba[..., 3:])
        assert abs(truth - expected).max() <= 1.0
        assert drawn[number].shape == truth.shape


def test_what_trainings_start_from_is_made_once_a_seed(task: ComparisonTask, tmp_path: Path) -> None:
    made: list[int] = []

    def prepared(pictures, seed: int):
        made.append(seed)
        return {"start": pictures.parameters[:2].clone() + seed}

    both = [Published(mean_method(name, prepare=prepared)) for name in ("one", "two")]
    study(task, tmp_path, *both, seeds=2).run()
    assert made == [0, 1]


def test_scores_name_every_metric(task: ComparisonTask, tmp_path: Path) -> None:
    class Truth:
        names = ("the truth",)

        def batches(self, cases):
            for case in cases:
                yield [case], lambda c: [task.catalog.image(c.member, c.appearance, c.view)]

    cells = scored(Truth(), task)
    for cell in cells.values():
        assert cell["psnr"] == 60.0
        assert cell["ssim"] == pytest.approx(1.0)


def test_a_study_that_is_stopped_goes_on_where_it_was(task: ComparisonTask, tmp_path: Path) -> None:
    made, steps = study(task, tmp_path, until=time.monotonic()), list[int]()
    with pytest.raises(OutOfTime):
        made.run()
    assert [r.method for r in load(made.records)] == [TRIVIAL]
    until, turned = time.monotonic() + 1.0, [0.0]

    def loss(step: int) -> float:
        steps.append(step)
        turned[0] += 60.0 * SECOND / 40.0
        while step == 10 and time.monotonic() < until:  # after a quarter, when others look
            time.sleep(0.01)
        return 0.5

    method = Published(mean_method(loss=loss), clock=lambda: turned[0])
    with pytest.raises(OutOfTime):
        study(task, tmp_path, method, until=until).run()
    assert [r.method for r in load(made.records)] == [TRIVIAL]
    last = steps[-1]
    steps.clear()
    again = study(task, tmp_path, method)
    again.run()
    assert steps[0] == last + 1
    [result] = [r for r in load(made.records) if r.method == "mean"]
    assert not result.error
    assert result.steps == steps[-1]
    assert not (again.folder / FITS / result.name / "fit").exists()


@pytest.mark.parametrize(("factor", "trainings"), [(3.0, 2), (1.1, 1), (0.9, 1), (0.4, 2)])
def test_a_training_that_misses_its_time_is_made_again(
    task: ComparisonTask, tmp_path: Path, factor: float, trainings: int
) -> None:
    """Its steps take this many times as long as in both trials; within 15 % it stays."""
    turned, begun = [0.0], [0]

    def loss(step: int) -> float:
        begun[0] += step == 1
        turned[0] += 60.0 * SECOND / 400.0 * (1.0 if begun[0] <= TRIALS else factor)
        return 0.5

    made = study(task, tmp_path, Published(mean_method(loss=loss), clock=lambda: turned[0]))
    made.run()
    [result] = [r for r in load(made.records) if r.method == "mean"]
    assert begun[0] == TRIALS + trainings
    assert result.seconds == pytest.approx(60.0 * SECOND * (factor if trainings == 1 else 1.0), rel=0.02)
    assert result.steps == pytest.approx(400 if trainings == 1 else 400 / factor, rel=0.02)


def test_a_training_that_is_made_again_goes_on_where_it_was_stopped(task: ComparisonTask, tmp_path: Path) -> None:
    turned, begun, steps, until = [0.0], [0], list[int](), time.monotonic() + 2.0

    def loss(step: int) -> float:
        begun[0] += step == 1
        steps.append(step)
        turned[0] += 60.0 * SECOND / 400.0 * (1.0 if begun[0] <= TRIALS else 3.0)
        while begun[0] == TRIALS + 2 and step == 20 and time.monotonic() < until:
            time.sleep(0.01)
        return 0.5

    method = Published(mean_method(loss=loss), clock=lambda: turned[0])
    with pytest.raises(OutOfTime):
        study(task, tmp_path, method, until=until).run()
    last = steps[-1]
    assert (begun[0], 20 <= last < 133) == (TRIALS + 2, True)
    steps.clear()
    again = study(task, tmp_path, method)
    again.run()
    assert (steps[0], begun[0]) == (last + 1, TRIALS + 2)
    [result] = [r for r in load(again.records) if r.method == "mean"]
    assert result.steps == steps[-1] == pytest.approx(133, abs=2)
    assert result.seconds == pytest.approx(60.0 * SECOND, rel=0.02)


def test_published_steps_are_made_without_a_time(task: ComparisonTask, tmp_path: Path) -> None:
    ours = OurSurrogate("ours", "ours", "nobody")
    made = study(task, tmp_path, Published(mean_method()), ours, minutes=(AS_PUBLISHED,), plan=Plan(1, size="official"))
    made.run()
    [result] = [r for r in load(made.records) if r.method != TRIVIAL]
    assert (result.method, result.steps, result.size) == ("mean", 1000, "official")
    assert str(result.terms) == "sizes and steps as published"


def test_steps_are_taken_from_another_once_these_are_known(task: ComparisonTask, tmp_path: Path) -> None:
    ours = OurSurrogate("equal", "as many", "nobody", {"fit_to_need": False, "gaussians": 50}, steps_of="mean")
    alone = study(task, tmp_path, ours)
    alone.run()
    assert [r.method for r in load(alone.records)] == [TRIVIAL]
    turned = [0.0]

    def slow(_: int) -> float:
        turned[0] += 60.0 * SECOND / 9.0
        return 0.5

    method = Published(mean_method(loss=slow), clock=lambda: turned[0])
    both = study(task, tmp_path, ours, method), study(task, tmp_path, method, ours)
    for made in both:
        made.run()
    found = {r.method: r for r in load(both[0].records)}
    assert not found["equal"].error
    assert found["equal"].steps == found["mean"].steps == pytest.approx(9, abs=1)
    assert 0.0 < found["equal"].curve[-1][0] <= found["equal"].seconds


def test_our_curve_is_of_what_is_compared_on_the_comparisons_clock(tmp_path: Path) -> None:
    varied = varied_catalog(tmp_path / "varied.cdb", varied_surrogate())
    kinds = [variation.kind for variation in varied.plan.variations]
    stages = ["canonical", "deformation", *kinds]
    points = [
        {"stage": stage, "psnr": psnr, "seconds": 100.0 * n, "processor_seconds": float(n)}
        for n, (stage, psnr) in enumerate((stage, psnr) for stage in stages for psnr in (None, 20.0))
    ]
    trained = SimpleNamespace(training={"curve": points})
    base = ComparisonTask(varied)
    assert curve_of(trained, base, 0.5, "cpu") == [(1.5, 20.0), (3.5, 20.0)]
    assert curve_of(trained, base, 0.5, "cuda") == [(100.5, 20.0), (300.5, 20.0)]
    for number, variation in enumerate(varied.plan.variations):
        expected = [(n + 0.5, 20.0) for n in (5 + 2 * k for k, kind in enumerate(kinds) if kind == variation.kind)]
        assert curve_of(trained, ComparisonTask(varied, variation), 0.5, "cpu") == expected, number
