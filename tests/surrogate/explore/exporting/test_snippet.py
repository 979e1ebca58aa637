from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from catalogs.files.images import read_image, to_bytes
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.explore.exporting.snippet import snippet
from surrogate.explore.setting import Setting
from surrogate.model import Surrogate
from tests.support.field_blobs import FUNCTION
from tests.support.models import following, plain

PROJECT = Path(__file__).resolve().parents[4]
CAMERA = Camera.look_at((3.1, 4.2, 1 / 3), (0.1, 0, 0), vertical_fov_degrees=31.7, width=40, height=24)
SETTINGS = {
    "base": Setting({"p": 0.1 + 0.2}),
    "isovalue": Setting({"p": 1 / 3}, {"isovalue": 0.1 + 0.4}),
    "transfer function": Setting({"p": 1 / 3}, {"c1_value": 0.1, "c2_opacity": -1 / 7}),
    "colours": Setting({"p": 1 / 3}, {}, "turbo"),
    "transfer function and colours": Setting({"p": 1 / 3}, {"c1_value": 0.1, "c2_opacity": -1 / 7}, "viridis"),
    "any function": Setting({"p": 1 / 3}, function=replace(FUNCTION, opacity_points=((0.0, 0.1 + 0.2), (1.0, 0.9)))),
    "any function in other colours": Setting(
        {"p": 1 / 3}, {}, "plasma", function=replace(FUNCTION, opacity_points=((0.0, 0.1), (0.5, 0.9), (2.0, 0.0)))
    ),
    "numpy": Setting({"p": np.float64(1 / 3)}, {"c1_value": np.float32(0.1)}),
}


def run(program: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> NDArray[np.float32]:
    """The image of a snippet's program, executed in `folder`."""
    monkeypatch.chdir(folder)
    names: dict[str, NDArray[np.float32]] = {}
    exec(compile(program, "snippet", "exec"), names)
    return names["picture"]


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("background", [None, (0.1 + 0.2, 0.0, 1.0)])
def test_a_snippet_draws_the_same_bits(
    setting: Setting, background: tuple[float, ...] | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    following().save(tmp_path / "run" / "surrogate")
    program = snippet(tmp_path / "run" / "surrogate", following(), setting, CAMERA, background)
    expected = setting.member(following()).render(CAMERA, background=background)
    picture = run(program, tmp_path, monkeypatch)
    np.testing.assert_array_equal(picture, expected)
    assert np.ptp(expected[..., :3]) > 0.1
    stored = read_image(tmp_path / "picture.png").astype(int)
    np.testing.assert_allclose(stored, np.minimum(to_bytes(expected), to_bytes(expected)[..., 3:]), atol=0)


def test_units_are_said(tmp_path: Path) -> None:
    heated = replace(plain(), space=ParameterSpace((Parameter("p", 0.0, 1.0, "K/s"),)))
    assert "\n# p in K/s\npicture = " in snippet(tmp_path, heated, SETTINGS["base"], CAMERA, None)
    assert "# p" not in snippet(tmp_path, plain(), SETTINGS["base"], CAMERA, None)


@pytest.mark.slow
def test_it_runs_as_a_program_of_its_own(tmp_path: Path) -> None:
    following().save(tmp_path / "model")
    program = snippet(tmp_path / "model", following(), SETTINGS["colours"], CAMERA.resized(30, 18), None)
    script = (
        f"import sys\nsys.path.insert(0, {str(PROJECT)!r})\n{program}\nimport numpy\nnumpy.save('picture.npy', picture)"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    expected = SETTINGS["colours"].member(following()).render(CAMERA.resized(30, 18))
    np.testing.assert_array_equal(np.load(tmp_path / "picture.npy"), expected)


def test_the_colours_stand_in_it_by_name(tmp_path: Path) -> None:
    program = snippet(tmp_path, following(), SETTINGS["colours"], CAMERA, None)
    assert "color_points=color_points('turbo', 0.0, 3.0)," in program
    assert "surrogate.under(function, p=0.3333333333333333).render(camera)" in program


@pytest.mark.parametrize("name", ["self", "outside", "profile", "Ω m", "lambda", "a'b\"", "Ω"])
def test_any_parameter_name_will_do(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    named: Surrogate = replace(plain(), space=ParameterSpace((Parameter(name, 0.0, 1.0),)))
    folder = tmp_path / 'it\'s a "run"'
    named.save(folder)
    setting = Setting({name: 0.3})
    picture = run(snippet(folder, named, setting, CAMERA, None), tmp_path, monkeypatch)
    np.testing.assert_array_equal(picture, setting.member(named).render(CAMERA))


def test_it_is_formatted_as_the_project_is(tmp_path: Path) -> None:
    for setting in SETTINGS.values():
        program = snippet(tmp_path, following(), setting, CAMERA, (0.0, 0.0, 0.0))
        options = ["check", "--select", "E,F,W,I", "--line-length", "500", "--stdin-filename", "snippet.py", "-"]
        command = [sys.executable, "-m", "ruff", *options]
        done = subprocess.run(command, input=program, cwd=PROJECT, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stdout
