"""Other people's programs open our catalogs: every image, with the very pixels that were put in.

pycinema and cinemasci live in environments of their own (`make clients`): they conflict with each other.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.tools.packing import pack

PROJECT = Path(__file__).resolve().parents[3]
SCRIPTS = PROJECT / "tests" / "clients"


def run_client(client: str, script: str, *arguments: str) -> str:
    """Standard output of a script run by the client's own Python; the test skips where its environment is not made."""
    environment = PROJECT / f".venv-{client}"
    if not (environment / ".complete").exists():
        pytest.skip(f"{client} is not installed in {environment.name}: `make clients` does it")
    variables = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "MPLCONFIGDIR": str(environment / ".matplotlib")}
    done = subprocess.run(
        [environment / "bin" / "python", SCRIPTS / script, *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        env=variables,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr, done.stderr  # pycinema prints them and goes on with nothing
    return done.stdout


def straight(premultiplied: np.ndarray) -> np.ndarray:
    """The image for a viewer, from the definition: color divided by alpha, rounded; [H, W, 4] float."""
    values = premultiplied.astype(np.float64)
    alpha = np.maximum(values[..., 3:], 1.0)
    return np.concatenate([np.floor(255.0 * values[..., :3] / alpha + 0.5), values[..., 3:]], axis=-1)


def rows_of(catalog: Catalog) -> list[tuple[str, str, int]]:
    return [
        (member.name, appearance, view)
        for member in catalog.members
        for appearance in catalog.appearance_names
        for view in range(len(member.cameras))
    ]


@pytest.mark.slow
def test_pycinema_sees_every_image_as_it_was(catalog: Catalog, tmp_path: Path) -> None:
    run_client("pycinema", "read_with_pycinema.py", str(catalog.path), str(tmp_path / "seen.npz"))
    with np.load(tmp_path / "seen.npz", allow_pickle=False) as seen:
        header, rows, files, images = (seen[name] for name in ("header", "rows", "files", "images"))
    expected = rows_of(catalog)
    assert len(images) == len(expected) == 2 * 2 * 12
    assert header.tolist()[:2] == ["Re", "Pr"]
    assert header.tolist()[-2:] == ["FILE", "id"]  # pycinema adds the last
    by_file = dict(zip(files.tolist(), images, strict=True))
    assert len(by_file) == len(expected)
    for member, appearance, view in expected:
        image = by_file[str(catalog.image_path(member, appearance, view))]
        np.testing.assert_array_equal(image, straight(catalog.image(member, appearance, view)))
    column = {name: i for i, name in enumerate(header.tolist())}
    parameters = {row[column["member"]]: float(row[column["Re"]]) for row in rows.tolist()}
    assert parameters == {m.name: m.parameters["Re"] for m in catalog.members}


@pytest.mark.slow
def test_pycinema_sees_every_image_of_a_packed_catalog(catalog: Catalog, tmp_path: Path) -> None:
    pack(catalog.path, tmp_path / "packed.cdb")
    run_client("pycinema", "read_packed_with_pycinema.py", str(tmp_path / "packed.cdb"), str(tmp_path / "seen.npz"))
    with np.load(tmp_path / "seen.npz", allow_pickle=False) as seen:
        rows, images = seen["rows"].tolist(), seen["images"]
    expected = rows_of(catalog)
    assert sorted((member, appearance, int(view)) for member, appearance, view in rows) == sorted(expected)
    for (member, appearance, view), image in zip(rows, images, strict=True):
        np.testing.assert_array_equal(image, straight(catalog.image(member, appearance, int(view))))


def test_cinemasci_finds_the_file_of_every_row(catalog: Catalog) -> None:
    queries: list[dict[str, Any]] = [
        {"member": member, "appearance": appearance, "view": str(view)} for member, appearance, view in rows_of(catalog)
    ]
    queries += [{"Re": "120.0"}, {"Re": "120"}, {"split": "test"}, {"view_split": "test", "appearance": "dvr"}]
    text = run_client("cinemasci", "read_with_cinemasci.py", str(catalog.path), *map(json.dumps, queries))
    seen = json.loads(text.strip().splitlines()[-1])
    assert seen["accepted"]
    assert seen["names"][:3] == ["Re", "Pr", "appearance"]
    count = len(rows_of(catalog))
    for (member, appearance, view), answer in zip(rows_of(catalog), seen["answers"][:count], strict=True):
        assert answer == [str(catalog.image_path(member, appearance, view))]
        assert Path(answer[0]).is_file()
    by_float, by_integer, test_rows, test_views = seen["answers"][count:]
    assert by_float == by_integer
    assert len(by_float) == 2 * 12, "one member: two appearances of twelve views"
    splits = [m.row_split(v) for m in catalog.members for v in range(12)]
    assert len(test_rows) == 2 * splits.count("test")
    assert len(test_views) == 2 * 6
