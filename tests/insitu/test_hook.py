"""The hook: what it writes, what it costs, and that bad input changes nothing."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insitu
from catalogs import durable
from catalogs.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.catalog import Catalog
from catalogs.check import check
from catalogs.scene import ViewPlan

FUNCTION = TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.2, 0.0), (1.0, 0.6)), 0.3)
VOLUME = VolumeRendering("dvr", FUNCTION)
SPACING = (0.1, 0.1, 0.1)


def blob(width: float = 0.5, size: int = 12) -> np.ndarray:
    """A Gaussian blob around the middle of the grid, (z, y, x)."""
    grid = np.meshgrid(*[np.linspace(-1.0, 1.0, size)] * 3, indexing="ij")
    return np.exp(-sum(g**2 for g in grid) / (2 * width**2)).astype(np.float32)


def render(path: Path, field: Any = None, reynolds: float = 150.0, **changes: Any) -> insitu.RenderedMember:
    options: dict[str, Any] = {
        "space": {"Re": (100.0, 200.0)},
        "appearances": VOLUME,
        "views": ViewPlan(frequency=1, width=24, height=24),
        "spacing": SPACING,
        "sample_distance": 0.05,
    }
    options.update(changes)
    return insitu.render_member(blob() if field is None else field, {"Re": reynolds}, catalog=path, **options)


def tree(path: Path) -> dict[str, bytes]:
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file() and p.name != ".lock"}


@pytest.fixture
def catalog(tmp_path: Path) -> Path:
    """A catalog of one member."""
    path = tmp_path / "a.cdb"
    render(path)
    return path


def test_it_returns_what_it_wrote(tmp_path: Path) -> None:
    result = render(tmp_path / "a.cdb", time=2.5)
    made = Catalog.open(tmp_path / "a.cdb")
    assert result.images == 12
    assert result.path.is_dir()
    assert result.range == (float(blob().min()), float(blob().max()))
    assert result.clipped_fraction == pytest.approx(np.mean(blob() < 0.0))
    assert 0 <= result.extra_memory < 2e9
    assert result.seconds >= result.render_seconds + result.write_seconds
    assert made.members[0].provenance["time"] == 2.5
    assert check(made.path) == []
    assert "12 images" in repr(result)


def test_the_summary_knows_the_field(catalog: Path) -> None:
    kept = Catalog.open(catalog).members[0].summary()
    assert kept is not None
    values = blob()
    inside = (values >= kept.bin_edges[0]) & (values <= kept.bin_edges[-1])
    assert kept.histogram.sum() == inside.sum()
    assert np.array_equal(kept.histogram, np.histogram(values, bins=kept.bin_edges)[0])
    assert len(kept.points) == 4000
    assert np.allclose(kept.point_opacities, FUNCTION.opacities(kept.point_values), atol=1e-6)
    # Sampled in proportion to opacity: the mean squared distance from the middle is that of the opacity itself.
    coordinates = np.stack(np.meshgrid(*[np.arange(12) * 0.1] * 3, indexing="ij"), axis=-1) - 0.55
    weights = FUNCTION.opacities(values)
    wanted = (weights * (coordinates**2).sum(-1)).sum() / weights.sum()
    got = ((kept.points - 0.55) ** 2).sum(axis=1).mean()
    assert got == pytest.approx(wanted, rel=0.15)
    assert (catalog / "members").stat().st_size < 1e6


def test_nothing_is_normalized_per_member(tmp_path: Path) -> None:
    path = tmp_path / "a.cdb"
    render(path, reynolds=110.0)
    render(path, field=0.5 * blob(), reynolds=120.0)
    made = Catalog.open(path)
    full, half = (made.images(m, "dvr", range(12)).astype(float)[..., 3].mean() for m in made.members)
    assert half < 0.6 * full


def with_nan() -> np.ndarray:
    field = blob()
    field[2, 3, 4] = np.nan
    return field


BAD: dict[str, tuple[Callable[[], Any], dict[str, Any], str]] = {
    "nan": (with_nan, {}, "(?i)nan|finite"),
    "infinity": (lambda: np.where(blob() > 0.9, np.inf, blob()), {}, "(?i)inf|finite"),
    "empty": (lambda: np.zeros((0, 5, 5)), {}, "(?i)sample|empty|size|axis"),
    "one voxel thick": (lambda: np.zeros((1, 5, 5)), {}, "(?i)sample|axis|thick"),
    "two-dimensional": (lambda: np.zeros((5, 5)), {}, "(?i)dimension|axes|shape"),
    "text": (lambda: np.full((3, 3, 3), "x"), {}, "(?i)number|type|dtype"),
    "complex": (lambda: np.zeros((3, 3, 3), complex), {}, "(?i)complex|number|type|dtype"),
    "flat spacing": (blob, {"spacing": (0.1, 0.1, 0.0)}, "(?i)spacing"),
    "no spacing": (blob, {"spacing": None}, "(?i)spacing"),
    "reaching out of the box": (blob, {"origin": (5.0, 0.0, 0.0)}, "(?i)box|origin"),
    "other transfer function": (blob, {"appearances": VolumeRendering("other", FUNCTION)}, "(?i)appearance"),
    "other views": (blob, {"views": ViewPlan(frequency=2, width=24, height=24)}, "(?i)views"),
    "unknown split": (blob, {"split": "tset"}, "split"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gets_one_clear_error_and_changes_nothing(catalog: Path, case: str) -> None:
    make, changes, message = BAD[case]
    before = tree(catalog)
    with pytest.raises((ValueError, TypeError), match=message):
        render(catalog, make(), reynolds=160.0, **changes)
    assert tree(catalog) == before


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"Re": 150.0}, "already"),
        ({}, "missing"),
        ({"Re": 160.0, "Ma": 0.1}, "unknown"),
        ({"Reynolds": 160.0}, "Reynolds"),
        ({"Re": float("nan")}, "finite"),
    ],
)
def test_wrong_parameters_change_nothing(catalog: Path, parameters: dict[str, float], message: str) -> None:
    before = tree(catalog)
    with pytest.raises(ValueError, match=message):
        insitu.render_member(blob(), parameters, catalog=catalog, spacing=SPACING)
    assert tree(catalog) == before


def test_a_bad_first_member_leaves_no_catalog(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"(?i)nan|finite"):
        render(tmp_path / "a.cdb", with_nan())
    assert not (tmp_path / "a.cdb").exists()


def test_holes_are_transparent_on_request(catalog: Path) -> None:
    result = render(catalog, with_nan(), reynolds=160.0, nan="transparent")
    assert np.isfinite(result.range).all()


def test_out_of_bounds_warns_and_is_recorded(catalog: Path) -> None:
    with pytest.warns(UserWarning, match="outside its bounds"):
        result = render(catalog, reynolds=300.0)
    member = Catalog.open(catalog).member(result.name)
    assert member.parameters["Re"] == 300.0
    assert "outside its bounds" in member.provenance["warnings"][0]


@pytest.mark.parametrize(
    ("field", "appearance"),
    [
        (np.full((8, 8, 8), 0.5, np.float32), VOLUME),
        (np.full((8, 8, 8), 0.5, np.float32), Isosurface("surface", 0.25)),
        (blob(), Isosurface("surface", 7.0)),
    ],
    ids=["constant field", "isosurface of a constant field", "empty isosurface"],
)
def test_what_has_little_to_show_is_rendered_as_it_is(tmp_path: Path, field: np.ndarray, appearance: Any) -> None:
    result = render(tmp_path / "a.cdb", field, appearances=appearance, sample_distance=None)
    assert result.images == 12
    made = Catalog.open(tmp_path / "a.cdb")
    shown = made.images(result.name, appearance.name, range(12))[..., 3].any()
    assert shown == isinstance(appearance, VolumeRendering)


def test_a_newer_catalog_is_refused(catalog: Path) -> None:
    path = catalog / "catalog.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "schema": 99}))
    before = tree(catalog)
    with pytest.raises(ValueError, match="newer"):
        render(catalog, reynolds=160.0)
    assert tree(catalog) == before


def test_a_full_disk_keeps_nothing_of_the_member(catalog: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = tree(catalog)

    def full(path: Path, data: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(durable, "write", full)
    with pytest.raises(OSError, match="could not be stored"):
        render(catalog, reynolds=160.0)
    assert tree(catalog) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(PermissionError):
        render(tmp_path / "a.cdb")


def test_data_sets_of_pyvista_and_vtk_are_taken(tmp_path: Path) -> None:
    import pyvista

    mesh = pyvista.ImageData(dimensions=(12, 12, 12), spacing=SPACING)
    mesh["density"] = blob().ravel()
    path = tmp_path / "a.cdb"
    render(path, reynolds=110.0)
    render(path, mesh, reynolds=120.0, spacing=None, array="density")
    made = Catalog.open(path)
    first, second = (made.images(m, "dvr", range(12)) for m in made.members)
    assert np.array_equal(first, second)


def test_a_session_renders_many_members_through_one_window(tmp_path: Path) -> None:
    views = ViewPlan(frequency=1, width=24, height=24)
    with insitu.Session(tmp_path / "a.cdb", space={"Re": (100, 200)}, appearances=VOLUME, views=views) as session:
        for reynolds in (110.0, 150.0, 190.0):
            session.render_member(blob(reynolds / 300.0), {"Re": reynolds}, spacing=SPACING)
    assert len(Catalog.open(tmp_path / "a.cdb").members) == 3
