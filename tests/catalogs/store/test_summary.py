"""The sidecar keeps what it was given, in kilobytes, and never runs code from a file."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.summary import FieldSummary, load_summaries, save_summaries
from tests.catalogs.conftest import summary


def test_it_reads_back_what_was_kept(tmp_path: Path) -> None:
    kept = summary(3)
    save_summaries(tmp_path / "field.npz", {"": kept})
    again = load_summaries(tmp_path / "field.npz")[""]
    assert all(np.array_equal(getattr(kept, f.name), getattr(again, f.name)) for f in fields(kept))


def test_six_thousand_points_take_kilobytes(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    points = random.random((4000, 3)).astype(np.float32)
    large = replace(
        summary(),
        points=points,
        point_values=points[:, 0],
        point_opacities=points[:, 1],
        even_points=points[:2000],
        even_values=points[:2000, 2],
    )
    save_summaries(tmp_path / "field.npz", {"": large})
    assert (tmp_path / "field.npz").stat().st_size < 120_000


@pytest.mark.parametrize("name", ["even_points", "even_values", "points", "minimum"])
def test_an_archive_that_lacks_an_array_is_refused(tmp_path: Path, name: str) -> None:
    save_summaries(tmp_path / "field.npz", {"": summary()})
    without(tmp_path / "field.npz", name)
    with pytest.raises(ValueError, match=r"field\.npz is not a field summary"):
        load_summaries(tmp_path / "field.npz")


@pytest.mark.parametrize("data", [b"", b"hello", pickle.dumps({"minimum": 1.0})])
def test_what_is_none_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "field.npz").write_bytes(data)
    with pytest.raises(ValueError, match=r"field\.npz"):
        load_summaries(tmp_path / "field.npz")


def test_pickled_objects_inside_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "field.npz", minimum=np.array({"a": 1}, dtype=object))
    with pytest.raises(ValueError, match=r"field\.npz"):
        load_summaries(tmp_path / "field.npz")


@pytest.mark.parametrize(
    "change",
    [
        {"points": np.zeros((5, 2))},
        {"point_values": np.zeros(4)},
        {"bin_edges": np.zeros(9)},
        {"even_points": np.zeros((3, 2))},
        {"even_values": np.zeros(2)},
    ],
    ids=lambda change: next(iter(change)),
)
def test_shapes_must_agree(change: dict[str, np.ndarray]) -> None:
    with pytest.raises(ValueError, match=r"must|needs"):
        replace(summary(), **change)  # type: ignore[arg-type]


def without(path: Path, *names: str) -> None:
    """Write the archive again, for each field without the arrays of these names."""
    with np.load(path) as archive:
        np.savez_compressed(path, **{name: a for name, a in archive.items() if name.split("/")[-1] not in names})


def same(first: FieldSummary, second: FieldSummary) -> bool:
    return all(np.array_equal(getattr(first, f.name), getattr(second, f.name)) for f in fields(first))


def test_the_archive_of_one_field_is_what_it_was(tmp_path: Path) -> None:
    save_summaries(tmp_path / "field.npz", {"": summary(3)})
    with np.load(tmp_path / "field.npz") as archive:
        assert set(archive) - {"allow_pickle"} == {f.name for f in fields(FieldSummary)}
    (only,) = load_summaries(tmp_path / "field.npz").items()
    assert only[0] == ""
    assert same(only[1], summary(3))


def test_several_fields_are_kept_by_name_and_the_first_as_ever(tmp_path: Path) -> None:
    kept = {"speed": summary(1), "q / 1 s²": summary(2), "1": summary(3)}
    save_summaries(tmp_path / "field.npz", kept)
    again = load_summaries(tmp_path / "field.npz")
    assert list(again) == list(kept)
    assert all(same(again[name], kept[name]) for name in kept)
    assert same(next(iter(again.values())), summary(1))
    with np.load(tmp_path / "field.npz", allow_pickle=False) as archive:  # as programs from before fields read it
        for f in fields(FieldSummary):
            assert np.array_equal(archive[f.name], getattr(summary(1), f.name))


@pytest.mark.parametrize("names", [[], ["a", "a"], ["a", "b", "c"]])
def test_an_archive_whose_names_do_not_fit_is_refused(tmp_path: Path, names: list[str]) -> None:
    path = tmp_path / "field.npz"
    save_summaries(path, {"a": summary(1), "b": summary(2)})
    with np.load(path) as archive:
        np.savez(path, **{**archive, "fields": np.array(names, dtype=np.str_)})
    with pytest.raises(ValueError, match=r"field\.npz is not a field summary"):
        load_summaries(path)


def test_an_archive_with_any_bit_flipped_is_read_or_refused(tmp_path: Path) -> None:
    """The zip format fails in many ways: in its entries, its checksums, and what was compressed."""
    path = tmp_path / "field.npz"
    save_summaries(path, {"q": summary(1), "speed": summary(2)})
    whole, random, refused = path.read_bytes(), np.random.default_rng(0), 0
    for place, bit in zip(random.integers(len(whole), size=600), random.integers(8, size=600), strict=True):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(bit)
        path.write_bytes(damaged)
        try:
            load_summaries(path)
        except ValueError as error:
            assert "field.npz" in str(error)  # noqa: PT017 - some flips change nothing
            refused += 1
    assert refused > 300
