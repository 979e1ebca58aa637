"""Gaussians as glTF, read by the text of glTF 2.0 and of KHR_gaussian_splatting."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from surrogate.explore.exporting.glb import glb_bytes
from surrogate.explore.exporting.splats import Splats
from tests.support.surrogates import some_surrogate

PREFIX = "KHR_gaussian_splatting:"
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def splats(color_columns: int = 3) -> Splats:
    return Splats.of(some_surrogate(color_columns).at(Re=1830.0, time=0.4))


def read(content: bytes) -> tuple[dict[str, Any], dict[str, NDArray[np.float32]]]:
    """The JSON document, and the arrays of the only primitive by name; the container is checked on the way."""
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    chunks, place = {}, 12
    while place < len(content):
        size, kind = struct.unpack_from("<I4s", content, place)
        assert size % 4 == 0
        chunks[kind] = content[place + 8 : place + 8 + size]
        place += 8 + size
    assert list(chunks) == [b"JSON", b"BIN\0"]
    document, data = json.loads(chunks[b"JSON"]), chunks[b"BIN\0"]
    assert document["buffers"] == [{"byteLength": len(data)}]
    (primitive,) = document["meshes"][0]["primitives"]
    arrays = {}
    for name, number in primitive["attributes"].items():
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126
        part = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        arrays[name] = np.frombuffer(part, "<f4").reshape(accessor["count"], WIDTHS[accessor["type"]])
    return document, arrays


@pytest.mark.parametrize(("columns", "degree"), [(3, 0), (12, 1)])
def test_geometry_and_colours_come_back(columns: int, degree: int) -> None:
    own = splats(columns)
    document, arrays = read(glb_bytes(own))
    assert set(arrays) == {
        "POSITION",
        "COLOR_0",
        *(f"{PREFIX}{name}" for name in ("ROTATION", "SCALE", "OPACITY")),
        *(f"{PREFIX}SH_DEGREE_{d}_COEF_{n}" for d in range(degree + 1) for n in range(2 * d + 1)),
    }
    away = np.array(document["nodes"][0]["translation"])  # in float64: the box lies far from the origin
    np.testing.assert_allclose(arrays["POSITION"] + away, own.means, atol=1e-5 * 40.0, rtol=0)
    np.testing.assert_allclose(arrays[f"{PREFIX}SCALE"], own.scales, rtol=1e-6)
    np.testing.assert_allclose(arrays[f"{PREFIX}OPACITY"][:, 0], own.opacities, rtol=1e-6)
    x, y, z, w = arrays[f"{PREFIX}ROTATION"].T
    np.testing.assert_allclose(np.stack([w, x, y, z], axis=1), own.quats, atol=1e-6)
    base = 0.2820947917738781 * arrays[f"{PREFIX}SH_DEGREE_0_COEF_0"] + 0.5
    np.testing.assert_allclose(base, own.coefficients[:, 0], atol=1e-6)
    for number in range(3 * degree):
        np.testing.assert_allclose(
            arrays[f"{PREFIX}SH_DEGREE_1_COEF_{number}"], own.coefficients[:, 1 + number], rtol=1e-5, atol=1e-7
        )


def test_the_document_is_what_the_extension_asks_for() -> None:
    own = splats()
    document, arrays = read(glb_bytes(own))
    assert document["extensionsUsed"] == ["KHR_gaussian_splatting"]
    (primitive,) = document["meshes"][0]["primitives"]
    assert primitive["mode"] == 0
    extension = primitive["extensions"]["KHR_gaussian_splatting"]
    assert extension == {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    bounds = document["accessors"][primitive["attributes"]["POSITION"]]
    np.testing.assert_array_equal(bounds["min"], arrays["POSITION"].min(axis=0))
    np.testing.assert_array_equal(bounds["max"], arrays["POSITION"].max(axis=0))
    np.testing.assert_allclose(np.linalg.norm(arrays[f"{PREFIX}ROTATION"], axis=1), 1.0, atol=1e-6)
    assert (arrays[f"{PREFIX}SCALE"] > 0.0).all()
    assert ((arrays["COLOR_0"] >= 0.0) & (arrays["COLOR_0"] <= 1.0)).all()
    linear = arrays["COLOR_0"][:, :3].astype(np.float64)
    displayed = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(displayed, own.coefficients[:, 0].clip(0.0, 1.0), atol=1e-5)
    assert document["scenes"][0]["extras"]["parameters"] == {"Re": 1830.0, "time": 0.4}
