"""The explorer with several representations: what draws a picture is chosen, and everything that is exported follows."""

from __future__ import annotations

import io
import runpy
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from surrogate.answers.doubt import Doubt
from surrogate.explore.exporting.exports import exported
from surrogate.explore.exporting.options import from_options
from surrogate.explore.exporting.sweep import Axis, Sweep, pictures
from surrogate.explore.facts import facts
from surrogate.explore.request import MessageError, frame_request
from surrogate.explore.run import Run
from surrogate.explore.server.frames import Frames
from surrogate.explore.setting import Setting
from surrogate.model.representation import BOTH, FIELD, GAUSSIANS
from surrogate.settings import TrainingSettings
from surrogate.storage.picture_records import record_of
from surrogate.training.run import train
from tests.support.field_catalogs import rendered

SETTINGS = TrainingSettings(gaussians=60, canonical_steps=4, deformation_steps=8, visualization_steps=6)
CAMERA = {"position": [3.0, 0.5, 0.5], "target": [0.5, 0.5, 0.5], "up": [0.0, 0.0, 1.0], "field": 30.0}
NO_OPTIONS: dict[str, Any] = {
    "parameters": (), "color_map": "", "using": "", "view": 0, "size": "", "background": "", "like": None, "compare": (),
}  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("using")
    catalog = rendered(folder / "a.cdb", surface=False)
    surrogate = train(SETTINGS, catalog, folder / "run" / "surrogate")
    return Run("run", surrogate, folder / "run" / "surrogate", catalog, folder / "run")


@pytest.fixture(scope="module")
def alone(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The same without Gaussians."""
    assert run.model_folder is not None
    folder = tmp_path_factory.mktemp("alone")
    shutil.copytree(run.model_folder / "field", folder / "field")
    return Run.open(folder)


def message(*settings: dict[str, Any], **more: Any) -> dict[str, Any]:
    shown = [{"parameters": {"p": 0.6}, **setting} for setting in settings or ({},)]
    return {"settings": shown, "camera": CAMERA, "size": [24, 24], "form": "png", **more}


def test_each_setting_is_drawn_by_what_it_names(run: Run) -> None:
    request = frame_request(message({"using": GAUSSIANS}, {"using": FIELD}, difference=True), run.surrogate)
    answer = Frames(run.surrogate).answer(request)
    assert answer["by"] == ["Gaussians", "emulated field"]
    assert answer["difference"]["maximum"] > 0.0
    [best] = Frames(run.surrogate).answer(frame_request(message(), run.surrogate))["pictures"]
    assert best == answer["pictures"][1]  # which validation prefers


@pytest.mark.parametrize("using", ["points", 3, None, ["field"]])
def test_other_names_are_refused(run: Run, using: object) -> None:
    with pytest.raises(MessageError, match="using must be one of gaussians, field, both or empty"):
        frame_request(message({"using": using}), run.surrogate)


def test_only_what_the_surrogate_holds_is_offered(run: Run, alone: Run) -> None:
    assert [one["name"] for one in facts(run)["model"]["representations"]] == [GAUSSIANS, FIELD, BOTH]
    assert all(one["megabytes"] > 0.0 < one["milliseconds"] for one in facts(run)["model"]["representations"])
    model = facts(alone)["model"]
    assert model["gaussians"] == 0
    assert [one["name"] for one in model["representations"]] == [FIELD]
    assert model["megabytes"] == model["representations"][0]["megabytes"]
    with pytest.raises(MessageError, match="using must be one of field or empty"):
        frame_request(message({"using": GAUSSIANS}), alone.surrogate)


@pytest.mark.parametrize("using", ["", GAUSSIANS, FIELD, BOTH])
def test_doubt_is_of_what_draws(run: Run, using: str) -> None:
    assert run.catalog is not None
    doubt, camera = Doubt.of(run.surrogate, run.catalog, run.folder), run.cameras[0]
    drawn = doubt.at({"p": 0.6}, using=using or FIELD)
    assert Setting({"p": 0.6}, using=using).doubted(doubt).interval(camera) == drawn.interval(camera)
    other = Doubt.of(run.surrogate.using(using or FIELD), run.catalog, run.folder)  # as kept, for all
    assert other.interval({"p": 0.6}, camera) == drawn.interval(camera)


def test_colors_that_are_chosen_are_doubted_as_any_function(run_folder: Path) -> None:
    run = Run.open(run_folder)
    assert run.catalog is not None
    doubt, setting = Doubt.of(run.surrogate, run.catalog, run.folder), Setting({"p": 0.6}, color_map="viridis")
    function = setting.transfer_function(run.surrogate)
    expected = doubt.interval({"p": 0.6}, run.cameras[0], function)
    assert expected.psnr is not None
    assert setting.doubted(doubt).interval(run.cameras[0]) == expected


@pytest.mark.parametrize("kind", ["png", "exr", "sheet", "comparison", "python"])
def test_exports_are_drawn_by_it(run: Run, kind: str) -> None:
    sweep = {"name": "p", "count": 2}
    contents = {}
    for using in ("", GAUSSIANS, FIELD):
        settings = [{"using": using}] * (2 if kind == "comparison" else 1)
        file = exported({**message(*settings), "kind": kind, "sweep": sweep}, run)
        contents[using] = file
        assert (using in file.name) == bool(using) or not using
        if kind not in ("python",):
            assert record_of(file.content)["using"] == using
    assert contents[GAUSSIANS].content != contents[FIELD].content
    assert len({file.name for file in contents.values()}) == 3


@pytest.mark.parametrize("using", ["", GAUSSIANS, FIELD, BOTH])
def test_sweeps_are_drawn_by_it(run: Run, using: str) -> None:
    camera = frame_request(message(), run.surrogate).camera
    sweep = Sweep(Setting({"p": 0.1}, using=using), Axis("p", 0.1, 0.9, 3))
    surrogate = run.surrogate.using(using) if using else run.surrogate
    expected = surrogate.render({"p": [0.1, 0.5, 0.9]}, camera, background=(0.2, 0.3, 0.4))
    np.testing.assert_array_equal(list(pictures(sweep, run.surrogate, camera, (0.2, 0.3, 0.4))), expected[..., :3])


def test_the_snippet_draws_the_same(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = message({"using": GAUSSIANS}, background="#000000")
    program = exported({**asked, "kind": "python"}, run).content.decode()
    assert '.using("gaussians")' in program
    (tmp_path / "draw.py").write_text(program)
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(tmp_path / "draw.py"))
    drawn = np.asarray(Image.open("picture.png").convert("RGB"))
    saved = Image.open(io.BytesIO(exported({**asked, "kind": "png"}, run).content)).convert("RGB")
    np.testing.assert_array_equal(drawn, np.asarray(saved))


def test_a_picture_that_was_drawn_by_one_is_drawn_so_again(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(exported({**message({"using": BOTH}), "kind": "png"}, run).content)
    again: Any = from_options(NO_OPTIONS | {"like": tmp_path / "a.png"}, "png", run)
    assert again.setting.using == BOTH
    assert from_options(NO_OPTIONS | {"using": FIELD}, "png", run).setting.using == FIELD  # type: ignore[union-attr]
    with pytest.raises(MessageError, match="using must be one of"):
        from_options(NO_OPTIONS | {"using": "nobody"}, "png", run)


def test_what_has_no_gaussians_has_no_ply(run: Run, alone: Run) -> None:
    assert exported({**message({"using": FIELD}), "kind": "ply"}, run).content.startswith(b"ply")
    with pytest.raises(ValueError, match=r"a \.ply holds Gaussians, and this surrogate has none"):
        exported({**message(), "kind": "ply"}, alone)


@pytest.mark.parametrize("kind", ["png", "exr", "sheet", "python"])
def test_a_field_alone_is_exported(alone: Run, kind: str) -> None:
    assert exported({**message(), "kind": kind, "sweep": {"name": "p", "count": 2}}, alone).content
