"""A scene is trained with other instructions, and its records are kept apart."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from catalogs.vocabulary.scene import Scene
from native import kernels
from research.benchmarks.results.processors import processors_section
from research.benchmarks.results.scenes import read_scene
from research.benchmarks.splatting.instruction_sets import emulated, load, main
from surrogate.settings import TrainingSettings
from tests.support.again import SCENE, rendered

TRAINED = (
    "\n[training]\ngaussians = 40\ncanonical_steps = 4\ndeformation_steps = 6\nlatent_size = 4\nhidden_width = 8\n"
)


def test_a_set_that_is_not_there_is_named() -> None:
    with pytest.raises(ValueError, match=r"this machine has the instruction sets .*baseline, not 'abacus'"):
        emulated("abacus")


@pytest.mark.slow
@pytest.mark.skipif(len(kernels.instruction_sets()) < 2, reason="this machine has one instruction set")
def test_other_instructions_round_otherwise_and_stand_in_a_row_of_their_own(
    tmp_path: Path, monkeypatch, capsys
) -> None:
    scene, runs, records = tmp_path / "again.toml", tmp_path / "runs", tmp_path / "records"
    scene.write_text(SCENE + TRAINED)
    rendered(scene, runs)
    command = ["instruction_sets", scene, "--runs", runs, "--records", records]
    monkeypatch.setattr(sys, "argv", [*map(str, command)])
    main()
    found = load(records / "again", TrainingSettings.from_table(Scene.load(scene).training).to_json())
    assert list(found) == sorted(kernels.instruction_sets()[1:])
    assert all(len(scores) == 2 for scores in found.values())
    assert "baseline: " in capsys.readouterr().out
    text = "\n".join(processors_section([read_scene(scene, records, runs)]))
    assert "no later than baseline" in text
    assert "research.benchmarks.splatting.instruction_sets scenes/again.toml" in text
    kept = {path: path.stat().st_mtime_ns for path in records.rglob("*.json")}
    main()
    assert {path: path.stat().st_mtime_ns for path in records.rglob("*.json")} == kept
