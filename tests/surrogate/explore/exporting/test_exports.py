"""The page and the commands ask for the same, and get the same bytes."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData

from surrogate.explore.exporting import commands
from surrogate.explore.exporting.exports import (
    FilmRequest,
    GaussiansRequest,
    PictureRequest,
    SheetRequest,
    exported,
    from_message,
)
from surrogate.explore.exporting.kinds import FILM_STEPS, KINDS
from surrogate.explore.exporting.options import extrapolations, from_options
from surrogate.explore.exporting.sweep import Axis, Sweep
from surrogate.explore.request import MessageError
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.storage.picture_records import record_of
from tests.support.exports import SWEEP, WRONG
from tests.support.models import plain
from tests.support.requests import CAMERA, message

OVER = {"name": "p", "low": 0.25, "high": "", "count": 4, "second": "", "secondCount": 2}


@pytest.fixture(scope="module")
def run(run_folder: Path) -> Run:
    return Run.open(run_folder)


def test_a_picture_is_what_is_drawn_and_knows_it(run: Run) -> None:
    made = exported(message(kind="png"), run)
    assert re.fullmatch(r"blobs-p-0.25-[0-9a-f]{6}\.png", made.name)
    assert made.media_type == "image/png"
    picture = np.asarray(Image.open(io.BytesIO(made.content)).convert("RGB")) / 255
    record = record_of(made.content)
    assert record["parameters"] == {"p": 0.25}
    from catalogs.vocabulary.cameras import Camera

    camera = Camera.from_json(record["camera"])
    expected = run.surrogate.at(p=0.25).render(camera, background=record["background"])[..., :3]
    assert np.abs(picture - expected).max() <= 0.51 / 255


def test_gaussians_are_read_by_others(run: Run) -> None:
    read = PlyData.read(io.BytesIO(exported(message(kind="ply"), run).content))
    deformed = run.surrogate.at(p=0.25)
    vertices = read["vertex"]
    np.testing.assert_allclose(np.stack([vertices[a] for a in "xyz"], axis=1), deformed.means, atol=1e-5)


def test_the_code_draws_the_picture(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = [{"parameters": {"p": 0.4}, "visualization": {"c2_value": -0.1}, "color_map": "turbo"}]
    asked = message(settings=shown)
    code = exported({**asked, "kind": "python"}, run).content.decode()
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "snippet", "exec"), {})
    drawn = np.asarray(Image.open(tmp_path / "picture.png").convert("RGB"))
    expected = np.asarray(Image.open(io.BytesIO(exported({**asked, "kind": "png"}, run).content)).convert("RGB"))
    assert np.abs(drawn.astype(int) - expected).max() <= 1


@pytest.mark.slow
def test_sweeps_become_sheets_and_films(run: Run) -> None:
    sheet = Image.open(io.BytesIO(exported(message(kind="sheet", sweep=SWEEP), run).content))
    assert sheet.width > 3 * 64
    grid = {**SWEEP, "second": "isovalue"}
    settings = [{"parameters": {"p": 0.5}, "visualization": {"isovalue": 0.3}}]
    taller = Image.open(io.BytesIO(exported(message(kind="sheet", sweep=grid, settings=settings), run).content))
    assert taller.height > sheet.height
    film = Image.open(io.BytesIO(exported(message(kind="gif", sweep={**SWEEP, "low": 0.2, "high": 0.4}), run).content))
    assert getattr(film, "n_frames", 0) == 2 * FILM_STEPS - 2
    assert exported(message(kind="mp4", sweep=SWEEP), run).content[4:8] == b"ftyp"


@pytest.mark.parametrize(("changes", "complaint"), WRONG)
def test_what_cannot_be_made_is_said(run: Run, changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        exported(message(**changes), run)


def test_what_is_no_message_is_refused(run: Run) -> None:
    for nothing in (None, [], "png", 3):
        with pytest.raises(MessageError):
            exported(nothing, run)


def test_names_of_files_are_harmless() -> None:
    made = exported(message(kind="png"), Run('../a"\r\nX: y', plain()))
    assert re.fullmatch(r"a-X-y-p-0.25-[0-9a-f]{6}\.png", made.name)
    assert set(KINDS) == {
        "comparison",
        "png",
        "exr",
        "ply",
        "glb",
        "spz",
        "vti",
        "html",
        "python",
        "sheet",
        "gif",
        "mp4",
    }
    assert json.dumps(made.name)


# ---- the page and the commands


def options(command: click.Command, *arguments: Any) -> dict[str, Any]:
    """The command line's reading of its arguments."""
    context = command.make_context("surrogate", ["tests", *map(str, arguments), "-o", "a"])
    return {name: value for name, value in context.params.items() if name not in ("run", "output")}


def nothing(*_: int) -> None:
    pass


@pytest.mark.parametrize("form", ["png", "exr"])
def test_a_picture_of_the_page_is_drawn_again_byte_for_byte(run: Run, tmp_path: Path, form: str) -> None:
    shown = [{"parameters": {"p": 0.3}, "visualization": {"c1_value": 0.1}, "color_map": "turbo"}]
    content = from_message(message(kind=form, settings=shown), run).content(run, nothing)
    (tmp_path / "page").write_bytes(content)
    again = from_options(options(commands.export, "--like", tmp_path / "page"), form, run)
    assert isinstance(again, PictureRequest)
    assert again.content(run, nothing) == content


def test_only_a_transparent_picture_has_alpha(run: Run) -> None:
    asked = from_message(message(kind="png"), run)
    assert isinstance(asked, PictureRequest)
    drawn, transparent = (request.content(run, nothing) for request in (asked, replace(asked, background=None)))
    assert [Image.open(io.BytesIO(content)).mode for content in (drawn, transparent)] == ["RGB", "RGBA"]


def test_gaussians_are_the_same(run: Run) -> None:
    asked = from_message(message(kind="ply"), run)
    again = from_options(options(commands.export, "-p", "p=0.25", "--refit", 0), "ply", run)
    assert isinstance(asked, GaussiansRequest)
    assert asked.content(run, nothing) == again.content(run, nothing)
    assert again.summary(run) == f"{len(run.surrogate.gaussians)} Gaussians, p = 0.25"


@pytest.mark.parametrize("form", ["gif", "mp4"])
def test_films_go_over_the_same_steps(run: Run, form: str) -> None:
    asked = from_message(message(kind=form, sweep=OVER, size=[16, 16]), run)
    given = options(commands.sweep, "--over", "p", "--from", 0.25, "-p", "p=0.25", "--there-and-back", "--size", 16)
    again = from_options(given, form, run)
    assert isinstance(asked, FilmRequest)
    assert isinstance(again, FilmRequest)
    assert asked.sweep == again.sweep == Sweep(Setting({"p": 0.25}), Axis("p", 0.25, 1.0, 49))
    same = replace(again, camera=asked.camera, background=asked.background)
    assert vars(same) == vars(asked)
    if form == "gif":  # H.264's bytes differ from run to run
        assert same.content(run, nothing) == asked.content(run, nothing)


def test_sheets_are_the_same(run: Run) -> None:
    asked = from_message(message(kind="sheet", sweep={**OVER, "second": "isovalue"}), run)
    down = ("--rows", "isovalue", "--rows-steps", 2, "-p", "p=0.25")
    again = from_options(options(commands.sweep, "--over", "p", "--from", 0.25, "--steps", 4, *down), "sheet", run)
    assert isinstance(asked, SheetRequest)
    assert isinstance(again, SheetRequest)
    assert asked.sweep == again.sweep
    same = replace(again, camera=asked.camera, background=asked.background)
    assert same.content(run, nothing) == asked.content(run, nothing)
    assert again.summary(run) == "8 pictures over p 0.25..1 and isovalue 0.1..0.8"


@pytest.mark.parametrize(
    ("kind", "arguments", "steps"),
    [("sheet", (), [8]), ("sheet", ("--rows", "isovalue"), [5, 5]), ("gif", (), [49]), ("gif", ("--steps", 7), [7])],
)
def test_steps_that_nobody_names(run: Run, kind: str, arguments: tuple[Any, ...], steps: list[int]) -> None:
    asked: Any = from_options(options(commands.sweep, "--over", "p", *arguments), kind, run)
    assert [axis.count for axis in asked.sweep.axes] == steps
    assert asked.background == (1.0, 1.0, 1.0)


def test_a_film_has_one_parameter(run: Run) -> None:
    given = options(commands.sweep, "--over", "p", "--rows", "isovalue")
    with pytest.raises(ValueError, match="a film goes over one parameter"):
        from_options(given, "gif", run)
    asked: Any = from_message(message(kind="gif", sweep={**OVER, "second": "isovalue"}), run)
    assert [axis.name for axis in asked.sweep.axes] == ["p"]  # the page has a film of a grid's columns


def test_a_whole_sweep_may_extrapolate(run: Run) -> None:
    given = options(commands.sweep, "--over", "isovalue", "--to", 0.9, "-p", "p=0.5")
    assert extrapolations(from_options(given, "sheet", run), run) == [
        "isovalue = 0.1 to 0.9 lies outside its bounds [0.1, 0.8]: extrapolating beyond the training range"
    ]
    assert extrapolations(from_options(options(commands.export), "ply", run), run) == []


def test_the_camera_of_a_message_is_that_of_its_frame(run: Run) -> None:
    asked: Any = from_message(message(kind="sheet", sweep=OVER), run)
    np.testing.assert_allclose(asked.camera.position, CAMERA["position"])
    assert (asked.camera.width, asked.camera.height) == (64, 48)
