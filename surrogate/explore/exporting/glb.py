"""Gaussians as binary glTF, by the extension KHR_gaussian_splatting.

Sources: glTF 2.0, section 4.4, "GLB-stored Buffer" and "Binary glTF Layout"; KHR_gaussian_splatting (release candidate of 2026),
sections "Extending Mesh Primitives", "Attributes", "Color Space" and "Fallback Behavior".
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.explore.exporting.splats import Splats

EXTENSION = "KHR_gaussian_splatting"
FLOAT, ARRAY_BUFFER, POINTS = 5126, 34962, 0
TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
LINEAR_BELOW = 0.04045  # of sRGB, IEC 61966-2-1


def glb_bytes(splats: Splats) -> bytes:
    """One mesh of points in a .glb file, about their mean, where a node puts them.

    Attributes are float32: `POSITION`, `ROTATION` (x, y, z, w), linear `SCALE` and `OPACITY`, and harmonics of all degrees that
    there are.  Colours are sRGB as displayed.  `COLOR_0` lets viewers without the extension show points; it is linear.  The scene's
    `extras` hold the parameters.  World axes stay as they are, although glTF has y up: the node does not turn them.
    """
    center = splats.means.mean(axis=0)
    harmonics, base = splats.harmonics, splats.coefficients[:, 0].clip(0.0, 1.0)
    linear = np.where(base <= LINEAR_BELOW, base / 12.92, ((base + 0.055) / 1.055) ** 2.4)
    arrays: dict[str, NDArray[np.float64]] = {
        "POSITION": splats.means - center,
        "COLOR_0": np.column_stack([linear, splats.opacities]),
        f"{EXTENSION}:ROTATION": splats.quats[:, [1, 2, 3, 0]],
        f"{EXTENSION}:SCALE": splats.scales,
        f"{EXTENSION}:OPACITY": splats.opacities[:, None],
    }
    number = 0
    for degree in range(splats.degree + 1):
        for order in range(2 * degree + 1):
            arrays[f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{order}"] = harmonics[:, number]
            number += 1
    views, accessors, parts, offset = [], [], [], 0
    for name, values in arrays.items():
        columns = np.ascontiguousarray(values, dtype="<f4")
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": columns.nbytes, "target": ARRAY_BUFFER})
        accessor: dict[str, Any] = {"bufferView": len(views) - 1, "componentType": FLOAT, "count": len(columns)}
        accessor["type"] = TYPES[columns.shape[1]]
        if name == "POSITION":  # which glTF asks to have bounds
            accessor |= {"min": columns.min(axis=0).tolist(), "max": columns.max(axis=0).tolist()}
        accessors.append(accessor)
        parts.append(columns.tobytes())
        offset += columns.nbytes
    primitive = {
        "attributes": {name: place for place, name in enumerate(arrays)},
        "mode": POINTS,
        "extensions": {EXTENSION: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}},
    }
    document = {
        "asset": {"version": "2.0", "generator": "gs-surrogate"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0], "extras": {"parameters": dict(splats.parameters)}}],
        "nodes": [{"mesh": 0, "translation": center.tolist()}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = [
        struct.pack("<I4s", len(part), kind) + part
        for kind, part in ((JSON_CHUNK, text), (BINARY_CHUNK, b"".join(parts)))
    ]
    return struct.pack("<4sII", b"glTF", 2, 12 + sum(map(len, chunks))) + b"".join(chunks)
