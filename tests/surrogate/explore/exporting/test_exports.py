from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData

from surrogate.explore.exporting.exports import exported
from surrogate.explore.exporting.kinds import FILM_STEPS, KINDS
from surrogate.explore.exporting.pictures import record_of
from surrogate.explore.request import MessageError
from surrogate.explore.run import Run
from tests.support.exports import SWEEP, WRONG
from tests.support.models import plain
from tests.support.requests import message


@pytest.fixture(scope="module")
def run(run_folder: Path) -> Run:
    return Run.open(run_folder)


def test_a_picture_is_what_is_drawn_and_knows_it(run: Run) -> None:
    made = exported(message(kind="png"), run)
    assert (made.name, made.media_type) == ("blobs.png", "image/png")
    picture = np.asarray(Image.open(io.BytesIO(made.content)).convert("RGB")) / 255
    record = record_of(made.content)
    assert record["parameters"] == {"p": 0.25}
    from catalogs.cameras import Camera

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
    assert made.name == "a-X-y.png"
    assert set(KINDS) == {"png", "exr", "ply", "python", "sheet", "gif", "mp4"}
    assert json.dumps(made.name)
