"""Coarse fields come back within half a step of their codes, in at most 0.3 MB each, and damage has a name."""

from __future__ import annotations

import io
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from catalogs.store.coarse import CoarseField, coarse_bytes, load_coarse_fields, save_coarse_fields

RNG = np.random.default_rng(5)
WAVES = np.sin(np.arange(64) / 9.0)[:, None, None] * np.cos(np.arange(64) / 7.0)[:, None] * np.sin(np.arange(64) / 5.0)
NOISE = RNG.random((64, 64, 64))
SMALL = RNG.random((5, 6, 7))


def with_holes(values: NDArray[Any], share: float) -> NDArray[Any]:
    return np.where(RNG.random(values.shape) < share, np.nan, values)


FIELDS: dict[str, NDArray[Any]] = {
    "smooth": WAVES.astype(np.float32),
    "noise, which no compression shrinks": NOISE.astype(np.float32),
    "holes": with_holes(WAVES, 0.3).astype(np.float32),
    "noise and holes": with_holes(NOISE, 0.3),
    "all holes but one": np.where(np.arange(210).reshape(5, 6, 7) == 100, 7.0, np.nan),
    "constant": np.full((4, 3, 2), 3.3, np.float32),
    "constant and huge": np.full((4, 3, 2), 1.7e308),
    "one sample": np.array([[[-2.5]]]),
    "large numbers": 1e300 * SMALL,
    "from end to end of float64": 1.7e308 * (2.0 * SMALL - 1.0),
    "subnormal": 1e-320 * SMALL,
    "a tiny range far from zero": 1e9 + 1e-6 * SMALL,
    "a tiny range far from zero in float32": (300.0 + 0.01 * SMALL).astype(np.float32),
    "whole numbers": np.arange(210.0).reshape(5, 6, 7).astype(np.float32),
    "two values": (NOISE > 0.5).astype(np.float32),
}


def coarse(values: NDArray[Any], **changes: Any) -> CoarseField:
    return CoarseField(
        **{"values": values, "spacing": (0.1, 0.2, 0.3), "origin": (1.0, 2.0, 3.0), "whole": True, **changes}
    )


@pytest.mark.parametrize("name", FIELDS)
def test_values_come_back_within_half_a_step(tmp_path: Path, name: str) -> None:
    values = FIELDS[name]
    path = tmp_path / "coarse.npz"
    save_coarse_fields(path, {"": coarse(values)})
    again = load_coarse_fields(path)[""]
    finite = ~np.isnan(values)
    assert np.array_equal(np.isnan(again.values), ~finite)
    wide, stored = values[finite].astype(np.longdouble), again.values[finite].astype(np.longdouble)
    step = (wide.max() - wide.min()) / (2**again.bits - 2)
    rounding = np.spacing(np.abs(again.values[finite])).astype(np.longdouble)  # of the type that they are in
    assert (np.abs(stored - wide) <= 0.5 * step + rounding).all()
    assert path.stat().st_size <= 300_000
    assert (again.spacing, again.origin, again.whole) == ((0.1, 0.2, 0.3), (1.0, 2.0, 3.0), True)


@pytest.mark.parametrize("name", [n for n in FIELDS if "float32" in n or FIELDS[n].dtype == np.float32])
def test_float32_stays_float32(tmp_path: Path, name: str) -> None:
    path = tmp_path / "coarse.npz"
    save_coarse_fields(path, {"": coarse(FIELDS[name])})
    assert load_coarse_fields(path)[""].values.dtype == np.float32


def test_bits_are_fewer_only_where_they_must_be(tmp_path: Path) -> None:
    both = {"smooth": coarse(WAVES), "noise": coarse(NOISE)}
    save_coarse_fields(tmp_path / "coarse.npz", both)
    again = load_coarse_fields(tmp_path / "coarse.npz")
    assert list(again) == ["smooth", "noise"]
    assert again["smooth"].bits == 16
    assert 8 <= again["noise"].bits < 10
    assert (tmp_path / "coarse.npz").stat().st_size <= 2 * 300_000


def test_differences_shrink_smooth_fields() -> None:
    def deflated(data: bytes) -> int:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return archive.getinfo("codes.npy").compress_size

    codes = np.rint((WAVES + 1.0) * 32767).astype(np.uint16)
    plain = io.BytesIO()
    np.savez_compressed(plain, codes=np.stack([codes >> 8, codes & 255]).astype(np.uint8))
    assert deflated(coarse_bytes({"": coarse(WAVES)})) < 0.85 * deflated(plain.getvalue())


def test_the_same_fields_make_the_same_file() -> None:
    assert coarse_bytes({"": coarse(WAVES)}) == coarse_bytes({"": coarse(WAVES.copy())})


def test_numpy_reads_the_file(tmp_path: Path) -> None:
    save_coarse_fields(tmp_path / "coarse.npz", {"": coarse(SMALL)})
    with np.load(tmp_path / "coarse.npz", allow_pickle=False) as archive:
        assert set(archive) == {"codes", "range", "spacing", "origin", "bits", "whole"}
        assert archive["range"].tolist() == [SMALL.min(), SMALL.max()]


BAD: dict[str, dict[str, Any]] = {
    "flat": {"values": np.zeros((4, 4))},
    "none": {"values": np.zeros((0, 4, 4))},
    "too many samples": {"values": np.zeros((65, 64, 64))},
    "integers": {"values": np.zeros((4, 4, 4), int)},
    "no spacing": {"spacing": (0.0, 1.0, 1.0)},
    "no place": {"origin": (math.nan, 0.0, 0.0)},
    "no bits": {"bits": 1},
}


@pytest.mark.parametrize("name", BAD)
def test_a_field_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="a coarse field"):
        coarse(**{"values": SMALL, **BAD[name]})


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_have_no_range_are_refused(value: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        coarse_bytes({"": coarse(np.full((2, 2, 2), value))})


def changed(data: bytes, **arrays: Any) -> bytes:
    with np.load(io.BytesIO(data)) as archive:
        before = {name: archive[name] for name in archive.files}
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=True, **{name: a for name, a in {**before, **arrays}.items() if a is not None})
    return stream.getvalue()


GOOD = coarse_bytes({"": coarse(SMALL)})
DAMAGE: dict[str, bytes] = {
    "empty": b"",
    "another file": b"\x89PNG\r\n",
    "cut": GOOD[: len(GOOD) // 2],
    "no codes": changed(GOOD, codes=None),
    "flat codes": changed(GOOD, codes=np.zeros((2, 10), np.uint8)),
    "three planes": changed(GOOD, codes=np.zeros((3, 5, 6, 7), np.uint8)),
    "wide codes": changed(GOOD, codes=np.zeros((2, 5, 6, 7), np.uint16)),
    "too many codes": changed(GOOD, codes=np.zeros((2, 65, 64, 64), np.uint8)),
    "far too many codes": changed(GOOD, codes=np.zeros((2, 512, 512, 64), np.uint8)),
    "a range of one": changed(GOOD, range=np.zeros(1)),
    "a range upside down": changed(GOOD, range=np.array([1.0, 0.0])),
    "a range of NaN": changed(GOOD, range=np.array([np.nan, 0.0])),
    "no spacing": changed(GOOD, spacing=np.zeros(3)),
    "17 bits": changed(GOOD, bits=np.array(17)),
    "words for bits": changed(GOOD, bits=np.array("many")),
    "objects": changed(GOOD, codes=np.array([{}], dtype=object)),
    "a field twice": changed(GOOD, fields=np.array(["q", "q"])),
    "fields that are not there": changed(GOOD, fields=np.array(["q", "speed"])),
    "no fields": changed(GOOD, fields=np.array([], dtype=np.str_)),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "coarse.npz").write_bytes(DAMAGE[name])
    with pytest.raises(ValueError, match=r"coarse\.npz is not a file of coarse fields"):
        load_coarse_fields(tmp_path / "coarse.npz")


def test_a_header_that_lies_takes_no_memory(tmp_path: Path) -> None:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "|u1", "fortran_order": False, "shape": (2, 1 << 40, 1, 1)})
    with zipfile.ZipFile(io.BytesIO(GOOD)) as old, zipfile.ZipFile(tmp_path / "coarse.npz", "w") as new:
        for entry in old.infolist():
            new.writestr(entry, stream.getvalue() if entry.filename == "codes.npy" else old.read(entry))
    with pytest.raises(ValueError, match=r"coarse\.npz is not a file of coarse fields"):
        load_coarse_fields(tmp_path / "coarse.npz")


def test_flipped_bytes_are_named_or_change_nothing(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    path = tmp_path / "coarse.npz"
    for place in rng.integers(0, len(GOOD), 150):
        data = bytearray(GOOD)
        data[place] ^= int(rng.integers(1, 256))
        path.write_bytes(bytes(data))
        try:
            again = load_coarse_fields(path)[""]
        except ValueError as error:
            assert "coarse.npz" in str(error)  # noqa: PT017 - some flips change nothing
        else:
            assert np.isfinite(again.values).all()
