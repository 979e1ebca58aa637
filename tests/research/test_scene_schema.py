"""The JSON schema of scenes: as the code makes it, valid, and of one mind with the program about good and bad scenes."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from catalogs.vocabulary.scene import Scene
from insitu.ensembles.sources import ensemble_of
from research.scene_schema import PATH, schema, text
from surrogate.settings import BOUNDS

PROJECT = Path(__file__).resolve().parents[2]
SCENES = sorted([*(PROJECT / "scenes").glob("*.toml"), *(PROJECT / "examples").glob("*/*.toml")])
VALIDATOR = jsonschema.Draft202012Validator(schema())


def test_the_file_is_what_the_code_makes() -> None:
    assert PATH.read_text() == text(), "python -m research.scene_schema"


def test_it_is_a_schema() -> None:
    VALIDATOR.check_schema(schema())


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_every_scene_fits(path: Path) -> None:
    assert [error.message for error in VALIDATOR.iter_errors(tomllib.loads(path.read_text()))] == []


def changed(keys: list[Any], value: Any) -> dict[str, Any]:
    scene = tomllib.loads((PROJECT / "scenes" / "tgv-tf.toml").read_text())
    place = scene = copy.deepcopy(scene)
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    return scene


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (["view"], {}),
        (["source", "kind"], "magic"),
        (["source", "resolutoin"], 64),
        (["parameters", 0, "scale"], "logarithmic"),
        (["parameters", 0, "low"], "zero"),
        (["members", "training"], 4),
        (["appearance", 0, "isovalue"], 3.0),
        (["appearance", 0, "transfer_function", "color_points"], [[0.0, 1.0]]),
        (["variation", 0, "first_step"], 1.0),
        (["variation", 0, "kind"], "camera"),
        (["views", "frequency"], 2.5),
        (["render", "nan"], "white"),
        (["render", "backend"], "gl"),
        (["training", "gausians"], 10),
        (["training", "carried"], "value"),
    ],
)
def test_mistakes_are_refused_by_both(keys: list[Any], value: Any, tmp_path: Path) -> None:
    scene = changed(keys, value)
    assert list(VALIDATOR.iter_errors(scene))
    path = tmp_path / "scene.toml"
    path.write_text(_toml(scene))
    with pytest.raises((ValueError, TypeError)):
        read_whole(path)


def read_whole(path: Path) -> None:
    loaded = Scene.load(path)
    loaded.check_tables()
    ensemble_of(loaded)


def _toml(scene: dict[str, Any]) -> str:
    """Of a scene's tables, all values inline."""

    def text_of(value: Any) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(f"{key} = {text_of(each)}" for key, each in value.items()) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(map(text_of, value)) + "]"
        return f'"{value}"' if isinstance(value, str) else str(value).lower()

    return "".join(f"{key} = {text_of(value)}\n" for key, value in scene.items())


def test_the_page_names_every_key_of_training() -> None:
    assert set(BOUNDS) <= set(schema()["properties"]["training"]["properties"])
