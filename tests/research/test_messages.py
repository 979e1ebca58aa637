"""Messages are collected as the programs print them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from catalogs import Catalog, CatalogError
from catalogs.vocabulary.scene import Scene
from research.messages import GAP, Message, messages, of_source

ALL = messages()


def matching(text: str) -> list[Message]:
    """The messages that may have become a text."""
    plain = " ".join(text.split())
    return [m for m in ALL if re.search(".*".join(map(re.escape, m.text.split(GAP))), plain, re.DOTALL)]


def test_there_are_as_many_as_a_count_of_raise_says() -> None:
    assert len(ALL) > 1000
    assert {message.module.partition(".")[0] for message in ALL} == {
        "catalogs",
        "insitu",
        "native",
        "render",
        "surrogate",
    }


def test_what_a_program_raises_is_among_them(tmp_path: Path) -> None:
    with pytest.raises(CatalogError) as absent:
        Catalog.open(tmp_path / "none.cdb")
    with pytest.raises(FileNotFoundError) as scene:
        Scene.load(tmp_path / "scene.toml")
    for error in (absent, scene):
        assert matching(str(error.value)), str(error.value)


def test_parts_of_a_text_are_joined() -> None:
    source = (
        'raise ValueError(f"{name} must be " + ("positive" if x else "odd") + f", got {value!r}")\n'
        'warnings.warn("it is blank: move the camera", stacklevel=2)\n'
        'raise KeyError("name")\n'
    )
    assert list(of_source(source, "m")) == [
        Message(f"{GAP} must be positive, got {GAP}", "ValueError", "m"),
        Message("it is blank: move the camera", "warning", "m"),
    ]
