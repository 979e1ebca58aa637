"""A training says at its start why it can't learn: empty images, few members, parameters that never vary, minutes too few."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.store.missing import report_missing
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.cli import main
from surrogate.report.page import empty_line
from surrogate.settings import TrainingSettings
from surrogate.training import pace
from surrogate.training.begin import TrainingOptions, begin
from surrogate.training.budget import Budget
from surrogate.training.content import require_content
from surrogate.training.messages import starting
from surrogate.training.source import Source
from tests.support.blobs import Blobs, stored

BLOBS = Blobs(count=3, size=12)
VIEWS = ("train", "train", "test")
PURPLE = (0.2, 0.0, 0.4)


def catalog_of(path: Path, rows: Sequence[tuple[float, float]], blank: Sequence[int] = ()) -> Catalog:
    """Training members at (p, q); the numbers in `blank` are of members whose images are empty."""
    cameras = BLOBS.cameras()[: len(VIEWS)]
    space = ParameterSpace((Parameter("p", 0.0, 1.0), Parameter("q", 0.0, 1.0)))
    catalog = Catalog.create(path, CatalogPlan(space, (ImportedImages("drawn"),), cameras, VIEWS, BLOBS.bounds))
    for number, (p, q) in enumerate(rows):
        with catalog.begin_member(f"m{number}", {"p": p, "q": q}) as writer:
            for view, camera in enumerate(cameras):
                picture = BLOBS.picture(p, camera)
                writer.write_image("drawn", view, np.zeros_like(picture) if number in blank else picture)
    return Catalog.open(catalog.path)


def said(catalog: Catalog) -> str:
    return "\n".join(starting(Source(TrainingSettings(), catalog)))


MANY = [(0.1 * i, 0.9 - 0.1 * i) for i in range(6)]


@pytest.mark.parametrize(
    ("rows", "blank", "expected"),
    [
        (MANY, (), []),
        (MANY[:1], (), ["1 member for training: a surrogate of so few"]),
        (MANY[:3], (), ["3 members for training: a surrogate of so few"]),
        (
            [(p, 0.25) for p, _ in MANY],
            (),
            ["q is 0.25 in all members for training, so nothing is learnt of it: render"],
        ),
        ([(100.0 * p, q) for p, q in MANY[1:]], (), ["all members lie outside the bounds [0, 1] of p, from 10 to 50"]),
        (MANY, (0,), []),
        (MANY, (0, 3), ["4 of 12 training images looked at are empty"]),
    ],
    ids=["enough", "one", "three", "a constant", "other units", "one empty", "two empty"],
)
def test_a_sentence_each(
    tmp_path: Path, rows: list[tuple[float, float]], blank: Sequence[int], expected: list[str]
) -> None:
    text = said(catalog_of(tmp_path / "a.cdb", rows, blank))
    assert len(text.splitlines()) == len(expected)
    assert all(sentence in text for sentence in expected)


def test_members_that_are_not_there_are_one_sentence(tmp_path: Path) -> None:
    catalog = catalog_of(tmp_path / "a.cdb", MANY)
    report_missing(catalog.path, "m8", {"p": 0.8, "q": 0.1}, "the disk was full")
    report_missing(catalog.path, "m9", {"p": 0.9, "q": 0.1}, "the disk was full")
    catalog.unfinished_folder("m7")
    text = said(catalog)
    assert "not all members of" in text
    assert "(2 missing, 1 unfinished): to finish them, run the command that rendered them again; `catalogs show" in text
    assert len(text.splitlines()) == 1


def test_members_without_the_learnt_appearance_are_counted(tmp_path: Path) -> None:
    cameras = BLOBS.cameras()[: len(VIEWS)]
    looks = ImportedImages("drawn"), ImportedImages("again")
    space = ParameterSpace((Parameter("p", 0.0, 1.0), Parameter("q", 0.0, 1.0)))
    catalog = Catalog.create(tmp_path / "a.cdb", CatalogPlan(space, looks, cameras, VIEWS, BLOBS.bounds))
    for number, (p, q) in enumerate(MANY):
        shown = ["drawn"] if number % 3 else ["again"]
        with catalog.begin_member(f"m{number}", {"p": p, "q": q}, appearances=shown) as writer:
            for view, camera in enumerate(cameras):
                writer.write_image(shown[0], view, BLOBS.picture(p, camera))
    source = Source(TrainingSettings(appearance="drawn"), Catalog.open(catalog.path))
    assert "(2 without images of drawn)" in "\n".join(starting(source))


@pytest.mark.parametrize("background", [None, PURPLE])
def test_empty_images_alone_are_refused_before_anything_is_written(
    tmp_path: Path, background: tuple[float, float, float] | None
) -> None:
    blank = stored(tmp_path / "blank.cdb", BLOBS, background=background, blank=True)
    with pytest.raises(
        ValueError, match=r"all 30 training images of drawn in .*blank\.cdb are empty.*transfer function"
    ):
        begin(blank.path, tmp_path / "run", TrainingOptions(Budget(steps=20)))
    assert not (tmp_path / "run").exists()
    shown = stored(tmp_path / "shown.cdb", BLOBS, background=background)
    require_content(Source(TrainingSettings(), shown))


@pytest.mark.slow
def test_one_image_that_shows_something_is_found_among_many(tmp_path: Path) -> None:
    rows = [(i / 99, 0.5) for i in range(100)]
    catalog = catalog_of(tmp_path / "a.cdb", rows, blank=[i for i in range(100) if i != 37])
    require_content(Source(TrainingSettings(), catalog))


def test_commands_say_it_once_and_refuse_a_scene_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    catalog_of(Path("few.cdb"), [(0.1, 0.5), (0.6, 0.5), (0.8, 0.5)])
    stored(Path("blank.cdb"), BLOBS, blank=True)
    trained = CliRunner().invoke(main, ["train", "few.cdb", "--steps", "8", "gaussians=20"])
    assert trained.exit_code == 0, trained.output
    for sentence in ("3 members for training: a surrogate", "q is 0.5 in all members for training"):
        assert trained.output.count(sentence) == 1
    Path("blank.toml").write_text('name = "blank"\n[source]\nkind = "catalog"\npath = "blank.cdb"\n')
    refused = CliRunner().invoke(main, ["train", "blank.toml"])
    assert refused.exit_code == 1
    assert refused.output.count("are empty, so nothing can be learnt") == 1


def test_the_report_counts_empty_images() -> None:
    assert empty_line({}) == empty_line({"empty": {"images": 0, "of": 9}}) == ""
    assert empty_line({"empty": {"images": 9, "of": 9}}).startswith("All 9 test images are empty: nothing was learnt")
    assert empty_line({"empty": {"images": 2, "of": 9}}).startswith("2 of 9 test images are empty: they are predicted")


@pytest.mark.slow
def test_minutes_that_are_too_short_name_some_that_suffice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pace, "LEAST_SECONDS", 0.2)
    catalog = catalog_of(tmp_path / "a.cdb", MANY)
    started = [pace.time.perf_counter()]

    def elapsed(start_up: float = 40.0) -> float:
        return start_up + pace.time.perf_counter() - started[0]

    with pytest.raises(
        ValueError, match=r"too short here: starting up and measuring .* took 4[0-9] s, loading"
    ) as error:
        begin(catalog.path, tmp_path / "run", TrainingOptions(Budget(minutes=0.5)), elapsed=elapsed)
    found = re.search(r"--minutes ([\d.]+) suffices", str(error.value))
    assert found is not None
    started[0] = pace.time.perf_counter()
    run = begin(catalog.path, tmp_path / "run", TrainingOptions(Budget(minutes=float(found[1]))), elapsed=elapsed)
    assert run.settings.deformation_steps > 0
