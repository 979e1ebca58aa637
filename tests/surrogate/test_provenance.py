from pathlib import Path

import pytest

from surrogate import provenance
from surrogate.provenance import code, machine


@pytest.fixture
def sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project of three modules, the first of which measures and imports the second."""
    for package in provenance.PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("")
    (tmp_path / "native" / "src").mkdir()
    (tmp_path / "native" / "src" / "kernels.cpp").write_text("int one() { return 1; }")
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
        ("native/src/kernels.cpp", "int one() { return 2; }", False),
        ("surrogate/explore.py", "import anything", True),
    ],
)
def test_code_changes_with_what_training_imports_and_nothing_else(
    sources: Path, file: str, text: str, same: bool
) -> None:
    before = code.__wrapped__()
    (sources / file).write_text(text)
    assert (code.__wrapped__() == before) is same


def test_the_code_of_this_project_is_found() -> None:
    found = provenance._statements()
    assert {"surrogate.training.run", "surrogate.training.loop", "surrogate.settings", "catalogs.catalog"} <= set(found)
    assert not any(name.startswith(("surrogate.explore", "surrogate.studies")) for name in found)
    assert len(code()) == 16


def test_a_machine_has_cores() -> None:
    assert int(machine()["cores"]) >= 1
