import subprocess
from pathlib import Path
from typing import Any

import pytest

from catalogs import version
from native import kernels
from surrogate import provenance
from surrogate.provenance import code, commit, in_words, machine


@pytest.fixture
def sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project of three modules, the first of which measures and imports the second."""
    for package in provenance.PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("")
    (tmp_path / "native" / "kernels" / "src").mkdir(parents=True)
    (tmp_path / "native" / "kernels" / "src" / "kernels.cpp").write_text("int one() { return 1; }")
    (tmp_path / "surrogate" / "run.py").write_text("import numpy\ndef train():\n    from catalogs import store\n")
    (tmp_path / "catalogs" / "store.py").write_text('"""Keeps."""\nSIZE = 1\n')
    (tmp_path / "catalogs" / "page.py").write_text("TITLE = 'a'\n")
    monkeypatch.setattr(provenance, "MEASURING", ("surrogate.run",))
    monkeypatch.setattr(provenance, "_folder", lambda package: tmp_path / package)
    return tmp_path


@pytest.mark.parametrize(
    ("file", "text", "same"),
    [
        ("catalogs/store.py", '"""Keeps more."""\nSIZE = 1  # a comment\n', True),
        ("catalogs/store.py", "SIZE = 2\n", False),
        ("catalogs/page.py", "TITLE = 'b'\n", True),
        ("surrogate/run.py", "import numpy\n", False),
        ("native/kernels/src/kernels.cpp", "int one() { return 2; }", False),
        ("surrogate/explore.py", "import anything", True),
    ],
)
def test_code_changes_with_what_training_imports_and_nothing_else(
    sources: Path, file: str, text: str, same: bool
) -> None:
    before = code.__wrapped__()
    (sources / file).write_text(text)
    assert (code.__wrapped__() == before) is same


def test_a_module_that_moved_has_the_code_that_it_had(sources: Path) -> None:
    before = code.__wrapped__()
    (sources / "catalogs" / "store.py").rename(sources / "catalogs" / "shop.py")
    (sources / "surrogate" / "run.py").write_text("import numpy\ndef train():\n    from catalogs import shop\n")
    assert code.__wrapped__() == before


@pytest.mark.slow
def test_modules_beside_the_product_decide_where_they_are_named() -> None:
    found = provenance._statements("tests.support.clouds")
    assert {"tests.support.clouds", "surrogate.training.run"} <= set(found)
    assert code("tests.support.clouds") != code()


def test_the_code_of_this_project_is_found() -> None:
    found = provenance._statements()
    assert {"surrogate.training.run", "surrogate.training.loop", "surrogate.settings", "catalogs.store.catalog"} <= set(
        found
    )
    assert not any(name.startswith("surrogate.explore") for name in found)
    assert len(code()) == 16


def test_a_commit_is_dirty_with_changes_but_not_with_new_measurements(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record, source = tmp_path / "research" / "records" / "a.json", tmp_path / "catalogs" / "version.py"

    def git(*arguments: str) -> str:
        who = ["-c", "user.name=a", "-c", "user.email=a@b"]
        return subprocess.run(
            ["git", *who, *arguments], cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout

    for path in (record, source):
        path.parent.mkdir(parents=True)
        path.write_text("1")
    git("init", "-q")
    git("add", ".")
    git("commit", "-qm", "Begin")
    monkeypatch.setattr(version, "HERE", source)
    clean = commit()
    assert git("rev-parse", "HEAD").startswith(clean)
    assert len(clean) == 12
    record.write_text("2")
    assert commit() == clean
    source.write_text("2")
    assert commit() == f"{clean}+dirty"
    monkeypatch.setattr(version, "HERE", tmp_path.parent / "version.py")
    assert commit() == "unknown"


def test_a_machine_has_cores_and_instructions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GS_SURROGATE_INSTRUCTION_SET", raising=False)
    assert int(machine()["cores"]) >= 1
    assert machine()["instructions"] == kernels.instruction_sets()[0]
    monkeypatch.setenv("GS_SURROGATE_INSTRUCTION_SET", "baseline")
    assert machine()["instructions"] == "baseline"


@pytest.mark.parametrize(
    ("known", "words"),
    [
        ({"processor": "abacus", "cores": 2}, "abacus, 2 cores"),
        ({"processor": "abacus", "cores": 1}, "abacus, 1 core"),
        ({"processor": "abacus", "instructions": "beads", "cores": 2}, "abacus (beads), 2 cores"),
        ({}, "an unknown processor, ? cores"),
    ],
)
def test_a_machine_in_words(known: dict[str, Any], words: str) -> None:
    assert in_words(known) == words
