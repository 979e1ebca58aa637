from itertools import count
from pathlib import Path

import pytest

from catalogs.vocabulary.appearance import Appearance, ImportedImages, Isosurface, TransferFunction, VolumeRendering
from surrogate.settings import TrainingSettings
from surrogate.training import budget
from surrogate.training.budget import Budget, Worth, budgeted
from surrogate.training.pace import Pace
from tests.support.results import make_catalog


@pytest.mark.parametrize(
    ("visible", "images", "changing", "steps", "count"),
    [
        (1_500, 448, 0.6, 5_000, 8_100),
        (6_000, 10_000, 0.6, 100_000, 16_000),
        (25_000, 1_260, 0.6, 5_000, 33_000),
        (3_400, 3_920, 0.6, 8_055, 12_000),  # a twentieth of a picture of 256 x 256
        (2048 * 2048, 1_260, 0.6, 5_000, 60_000),
        (6_000, 10_000, 0.6, 10_000, 8_100),  # half of the steps that so many images need
        (6_000, 10_000, 0.0, 10_000, 8_100),
        (6_000, 10_000, 0.6, None, 16_000),
        (6_000, 1_000, 0.0, 8_000, 32_000),  # alike, and four times as many steps
        (6_000, 1_000, 0.5, 8_000, 16_000),
        (25_000, 1_000, 0.0, 80_000, 60_000),
        (6_000, 10_000, 0.0, 1, 4_100),
        (1, 1, 0.0, 1, 1_000),
        (0, 10_000, 0.0, 100_000, 1_000),  # nothing is seen
    ],
)
def test_gaussians_follow_from_what_is_seen_and_steps(
    visible: float, images: int, changing: float, steps: int | None, count: int
) -> None:
    assert Worth(visible, images, changing).gaussians(steps) == count


@pytest.mark.parametrize(
    ("downsampling", "changing", "steps", "count"),
    [
        (1, 0.6, 2_500, 60_000),
        (4, 0.6, 2_500, 18_000),  # what pictures of a quarter of the side are worth
        (4, 0.6, 10_000, 30_000),
        (4, 0.6, 100_000, 60_000),
        (4, 0.6, None, 60_000),
        (8, 0.6, 500, 8_800),
        (4, 0.6, 250, 15_000),  # less than a quarter of what whole pictures are worth never
        (1, 0.1, 2_500, 60_000),
    ],
)
def test_in_little_time_there_are_as_many_gaussians_as_downsampled_pictures_are_worth(
    downsampling: int, changing: float, steps: int | None, count: int
) -> None:
    assert Worth(113_000, 589, changing, downsampling=downsampling).gaussians(steps) == count


def test_steps_lead_to_the_same_settings_everywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(budget, "measure_pace")
    settings, chosen = budgeted({"seed": 1}, make_catalog(tmp_path, "blobs"), Budget(steps=1_000))
    assert (settings.canonical_steps, settings.deformation_steps, settings.seed) == (60, 940, 1)
    assert chosen == {"gaussians": settings.gaussians, "steps": 1_000}
    assert settings.validation_interval == 62


@pytest.mark.parametrize("elapsed", [0.0, 100.0])
def test_minutes_are_spent_on_loading_steps_and_choices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, elapsed: float
) -> None:
    pace = Pace(0.010, (), 0.002, 0.001)
    monkeypatch.setattr(budget, "measure_pace", lambda *_: pace)
    settings, chosen = budgeted({}, make_catalog(tmp_path, "blobs"), Budget(minutes=10.0), lambda: elapsed)
    steps = settings.canonical_steps + settings.deformation_steps
    assert (steps, chosen["compressed"]) == (chosen["steps"], True)
    choices = 0.010 * steps * (budget.COMPRESSION + budget.COLOR_PROBES) + 0.002 * budget.PICTURES
    validated = 0.002 * 3 * budget.VALIDATIONS  # of three images
    assert 0.010 * steps + choices + validated == pytest.approx(600.0 - elapsed - budget.SPARE - 6 * 0.001, abs=0.1)


@pytest.mark.parametrize(("draw", "validations"), [(0.001, 16), (1.0, 10), (5.0, 4)])
def test_validation_takes_a_small_share_where_drawing_is_slow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, draw: float, validations: int
) -> None:
    monkeypatch.setattr(budget, "measure_pace", lambda *_: Pace(0.5, (), draw, 0.0))
    settings, chosen = budgeted({"fit_to_need": False}, make_catalog(tmp_path, "blobs"), Budget(minutes=10.0))
    assert settings.validation_interval == chosen["steps"] // validations
    images = 3
    spent = 0.5 * (1.0 + budget.COLOR_PROBES) * chosen["steps"] + images * validations * draw
    assert spent == pytest.approx(600.0 - budget.SPARE, abs=1.0)


def test_in_little_time_there_are_fewer_gaussians_and_no_choices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[int] = []

    def pace(source: budget.Source, *_: object) -> Pace:
        tried.append(source.settings.gaussians)
        return Pace(0.012, (), 0.02, 0.001)

    monkeypatch.setattr(budget, "measure_pace", pace)
    monkeypatch.setattr(budget, "SECONDS_PER_STEP", 0.02)
    settings, chosen = budgeted({}, make_catalog(tmp_path, "blobs"), Budget(minutes=0.5))
    assert tried == [settings.gaussians]
    assert settings.gaussians < 2_000
    assert not settings.fit_to_need
    assert chosen["steps"] * 0.012 < 30.0
    kept, _ = budgeted({"gaussians": 2_000, "fit_to_need": True}, make_catalog(tmp_path, "more"), Budget(minutes=0.5))
    assert (kept.gaussians, kept.fit_to_need) == (2_000, True)


@pytest.mark.slow
@pytest.mark.parametrize("minutes", [0.5, 2.0])
def test_a_busy_machine_makes_a_model_of_the_same_size_in_fewer_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, minutes: float
) -> None:
    catalog, ticks = make_catalog(tmp_path, "blobs"), count()
    monkeypatch.setattr(budget, "changing_share", lambda *_: 0.0)
    quiet, steps = budgeted({}, catalog, Budget(minutes=minutes), lambda: 0.05 * next(ticks))
    ticks = count()
    busy, fewer = budgeted({}, catalog, Budget(minutes=minutes), lambda: 0.2 * next(ticks))
    assert quiet.gaussians == busy.gaussians
    assert fewer["steps"] < 0.3 * steps["steps"]
    assert 0.2 * fewer["steps"] < 60.0 * minutes


@pytest.mark.parametrize(("rough", "given", "samples"), [(0.04, {}, 1), (0.06, {}, 2), (0.06, {"samples": 1}, 1)])
def test_rough_pictures_get_more_samples_in_a_pixel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rough: float, given: dict[str, int], samples: int
) -> None:
    tried: list[int] = []

    def pace(source: budget.Source, *_: object) -> Pace:
        tried.append(source.settings.samples)
        return Pace(0.010, (), 0.002, 0.001)

    monkeypatch.setattr(budget, "measure_pace", pace)
    monkeypatch.setattr(budget, "roughness", lambda *_: rough)
    catalog = make_catalog(tmp_path, "blobs")
    for asked in (Budget(minutes=10.0), Budget(steps=100)):
        assert budgeted(given, catalog, asked)[0].samples == samples
    assert set(tried) == {samples}


@pytest.mark.parametrize(("changing", "grown"), [(0.0, True), (0.9, False)])
def test_members_that_look_alike_get_more_gaussians_in_more_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changing: float, grown: bool
) -> None:
    tried: list[int] = []

    def pace(source: budget.Source, *_: object) -> Pace:
        tried.append(source.settings.gaussians)
        return Pace(1e-6 * source.settings.gaussians, (), 0.0, 0.0)

    monkeypatch.setattr(budget, "measure_pace", pace)
    monkeypatch.setattr(budget, "changing_share", lambda *_: changing)
    monkeypatch.setattr(budget, "available_cores", lambda: 1)
    for name, value in (("SECONDS_PER_STEP", 0.0), ("SECONDS_PER_GAUSSIAN", 1e-6), ("SECONDS_PER_PIXEL", 0.0)):
        monkeypatch.setattr(budget, name, value)
    settings, chosen = budgeted({}, make_catalog(tmp_path, "blobs"), Budget(minutes=10.0))
    assert tried == [settings.gaussians]
    assert (settings.gaussians > 3_000) == grown
    worth = Worth(2_000**2 / budget.PER_PIXEL, 6, changing).gaussians(chosen["steps"])
    assert settings.gaussians == pytest.approx(
        worth, rel=0.2
    )  # what the steps are worth, as the speed is the stated one


@pytest.mark.parametrize(("minutes", "lasting"), [(0.5, 0.9), (5.0, 9.0), (60.0, 20.0)])
def test_steps_are_planned_by_one_look_that_lasts_longer_in_more_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, minutes: float, lasting: float
) -> None:
    looked: list[float] = []

    def pace(source: budget.Source, rows: object, clock: object, seconds: float) -> Pace:
        looked.append(seconds)
        return Pace(0.012, (), 0.002, 0.0)

    monkeypatch.setattr(budget, "measure_pace", pace)
    _, chosen = budgeted({"gaussians": 2_000}, make_catalog(tmp_path, "blobs"), Budget(minutes=minutes))
    assert looked == pytest.approx([lasting])
    assert chosen["milliseconds_per_step"] == 12.0


FUNCTION = TransferFunction(((0.0, 1.0, 1.0, 1.0), (1.0, 0.0, 0.0, 0.0)), ((0.0, 0.0), (1.0, 1.0)), 0.1)


@pytest.mark.parametrize(
    ("shown", "asked", "degree"),
    [
        (ImportedImages("drawn"), "auto", 1),
        (Isosurface("surface", 0.5), "auto", 1),
        (VolumeRendering("lit", FUNCTION, shaded=True), "auto", 1),
        (VolumeRendering("unlit", FUNCTION), "auto", "auto"),
        (ImportedImages("drawn"), 0, 0),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_colours_that_may_depend_on_the_direction_are_planned_for(
    shown: Appearance, asked: int | str, degree: int | str
) -> None:
    assert budget._slowest(TrainingSettings(color_degree=asked), shown).color_degree == degree


@pytest.mark.parametrize(
    ("minutes", "steps", "said"),
    [
        (1.0, 10, "not in both"),
        (0.1, None, r"at least 0\.25, got 0\.1"),
        (float("nan"), None, "at least"),
        (float("inf"), None, "must be a time"),
        (-3.0, None, "at least"),
        (None, 0, "at least 1, got 0"),
    ],
)
def test_a_budget_must_be_one(minutes: float | None, steps: int | None, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Budget(minutes, steps)


def test_long_trainings_move_f_sim_at_lower_rates_and_what_is_given_stays(tmp_path: Path) -> None:
    catalog = make_catalog(tmp_path, "blobs")
    usual = TrainingSettings()
    for steps, factor in ((40, 1.0), (4_000, 1.0), (16_000, 0.5), (400_000, 0.1)):
        settings, _ = budgeted({}, catalog, Budget(steps=steps))
        assert settings.latent_rate == pytest.approx(factor * usual.latent_rate)
        assert settings.embedding_rate == pytest.approx(factor * usual.embedding_rate)
    given, _ = budgeted({"latent_rate": 0.03}, catalog, Budget(steps=16_000))
    assert given.latent_rate == 0.03
