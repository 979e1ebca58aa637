"""Suggested runs fill the space beside those that exist, and say what they are worth."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from surrogate.answers.next_runs import best_points, farthest, mean_lengths, next_runs
from surrogate.cli import main
from surrogate.emulation import EmulatedFields, FieldEmulator
from tests.support.field_catalogs import rendered

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return rendered(tmp_path_factory.mktemp("catalog") / "a.cdb", surface=False)


def _nearest(points: Array, others: Array) -> Array:
    return np.asarray(np.sqrt(((points[:, None] - others[None]) ** 2).sum(2)).min(1))


@pytest.mark.parametrize("dimensions", [1, 2, 6])
def test_the_farthest_leave_no_hole(dimensions: int) -> None:
    random = np.random.default_rng(0)
    points, candidates = random.uniform(-1.0, 0.2, (10, dimensions)), random.uniform(-1.0, 1.0, (2000, dimensions))
    chosen = candidates[farthest(candidates, points, 12)]
    assert _nearest(candidates, np.vstack([points, chosen])).max() < 0.9 * _nearest(candidates, points).max()
    apart = [_nearest(chosen[i : i + 1], np.vstack([points, chosen[:i]]))[0] for i in range(12)]
    assert apart == sorted(apart, reverse=True)  # each lies as far as it can, so distances fall
    assert len(set(farthest(candidates, points[:0], 5))) == 5


def test_the_best_lower_the_variance_most() -> None:
    """Beside an exhaustive search: for each candidate a process is conditioned anew, by dense linear algebra."""
    points, fields = _waves(9, 2)
    emulator = FieldEmulator.fit(points, fields, (1.0,) * 3, (0.0,) * 3)
    candidates = np.random.default_rng(5).uniform(-1.0, 1.0, (40, 2))

    def left(more: list[int]) -> float:
        processes, learnt = emulator.processes, np.vstack([points, candidates[more]])
        strengths = (processes.coefficients**2).mean(0)
        total = 0.0
        for k, group in enumerate(processes.groups):
            shares = _matern(learnt, learnt, processes.lengths[group]) + processes.noises[group] * np.eye(len(learnt))
            across = _matern(learnt, candidates, processes.lengths[group])
            total += strengths[k] * (1.0 - np.einsum("mc,mc->c", across, np.linalg.solve(shares, across))).sum()
        return total

    chosen = best_points(emulator, points, candidates, 3)
    for number, best in enumerate(chosen):
        each = [left([*chosen[:number], c]) for c in range(len(candidates)) if c not in chosen[:number]]
        assert left(chosen[: number + 1]) == pytest.approx(min(each), rel=1e-6)
        assert best not in chosen[:number]


def _matern(points: Array, others: Array, lengths: Array) -> Array:
    """Rasmussen & Williams 2006, equation 4.17, as it stands there."""
    r = np.sqrt((((points[:, None] - others[None]) / lengths) ** 2).sum(2))
    return np.asarray((1.0 + np.sqrt(5.0) * r + 5.0 * r**2 / 3.0) * np.exp(-np.sqrt(5.0) * r))


def _waves(count: int, seed: int) -> tuple[Array, NDArray[np.float32]]:
    """Points (M, 2), of which the first matters most, and fields (M, 2, 3, 5)."""
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 2))
    x = np.linspace(0.0, 1.0, 5)[None, None, :]
    fields = [np.broadcast_to(np.sin(5.0 * a + 0.2 * b + 3.0 * x), (2, 3, 5)) for a, b in points]
    return points, np.stack(fields).astype(np.float32)


def test_the_shorter_length_scale_is_that_of_the_stronger_parameter() -> None:
    points, fields = _waves(30, 0)
    lengths = mean_lengths(FieldEmulator.fit(points, fields, (1.0,) * 3, (0.0,) * 3))
    assert lengths[0] < 0.5 * lengths[1]


def test_runs_are_suggested_beside_all_members(catalog: Catalog) -> None:
    suggested = next_runs(catalog, EmulatedFields.fit(catalog), 4)
    existing = np.array([m.parameters["p"] for m in catalog.members])
    assert suggested.runs.shape == (4, 1)
    assert (np.abs(suggested.runs - existing[None]).min(1) > 0.03).all()
    assert suggested.curve is None
    assert "a learning curve takes 8 members or more, got 5" in str(suggested)
    assert set(suggested.errors) == {m.name for m in catalog.members if m.split == "train"}
    bare = next_runs(catalog, None, 4)
    assert bare.lengths is None
    assert "no coarse fields to learn from" in str(bare)


@pytest.mark.parametrize("count", [0, 257])
def test_impossible_numbers_are_refused(catalog: Catalog, count: int) -> None:
    with pytest.raises(ValueError, match=f"must be 1 to 256, got {count}"):
        next_runs(catalog, None, count)


def test_the_command_writes_a_table_and_a_figure(catalog: Catalog, tmp_path: Path) -> None:
    run = ["train", str(catalog.path), "--model", "field", "--steps", "5", "-o", str(tmp_path / "run")]
    assert CliRunner().invoke(main, run).exit_code == 0
    table, figure = tmp_path / "next.csv", tmp_path / "next.png"
    asked = ["ask", "next", str(tmp_path / "run"), "-n", "3"]
    result = CliRunner().invoke(main, [*asked, "-o", str(table), "--figure", str(figure)])
    assert result.exit_code == 0, result.output
    assert "3 runs beside 7 members" in result.output
    rows = list(csv.DictReader(table.open()))
    assert [list(row) for row in rows] == [["p"]] * 3
    assert all(0.0 <= float(row["p"]) <= 1.0 for row in rows)
    assert figure.read_bytes().startswith(b"\x89PNG")
    answered = json.loads(CliRunner().invoke(main, [*asked, "--json"]).output)
    assert [run["p"] for run in answered["runs"]] == pytest.approx([float(row["p"]) for row in rows], rel=1e-5)
