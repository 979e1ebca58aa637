"""One state of a surrogate as a file that other viewers of 3D Gaussians read.

The layout is that of the reference implementation of Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field
Rendering" (`GaussianModel.save_ply`): binary little-endian PLY, one vertex of float32 properties per Gaussian.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.explore.exporting.splats import CHANNELS, Splats

SMALLEST = 1e-7  # opacities are cut to this distance from 0 and 1: the format has their logits


def ply_bytes(splats: Splats) -> bytes:
    """The Gaussians as a PLY file, in world units.

    Properties are x y z, nx ny nz (zeros), f_dc_0..2, f_rest_*, opacity, scale_0..2, rot_0..3.  These are logits of opacities,
    log scales and unit quaternions w x y z.  There are 9 f_rest where colours depend on direction, 24 on lit surfaces, else
    none.  The reference adds 0.5 to the sum of its spherical harmonics, so f_dc is (color - 0.5) / `SH_C0`.  Its coefficients
    of degree 1 have our signs and order (y, z, x), channel by channel.  A comment holds the parameters as JSON.

    The opacity of Gaussians that absorb along rays is that of a ball of the same volume, from everywhere: the format has no other.
    Light on surfaces is given by its harmonics up to degree 2, which blur highlights.  All else, rendered again with this package's
    constants, agrees within 1e-4, but for a few pixels where Gaussians of equal depth change places.

    Generic viewers differ from this package, with the constants below by 23 to 42 dB on four trained models, with the cut colours
    alone by 37 to 52 dB:

    - they add 0.3 px² to the variance of every projected Gaussian; `Rasterizer.dilation` is mostly far less: small ones grow;
    - they cut each Gaussian's colour at 0 (some at 1 too); ours may be negative, and only the sum is cut;
    - their cap of alpha is 0.99, and their near plane is at 0.2 world units, whatever the size of the scene;
    - positions are float32 in world units: a box far from the origin loses digits;
    - they lack the background that opaque images were trained on (`Surrogate.background`);
    - some, such as the reference's own, accept only all 45 f_rest of degree 3 unless the degree is given.
    """
    table = _table(splats)
    header = (
        "ply",
        "format binary_little_endian 1.0",
        f"comment gs-surrogate {json.dumps(dict(splats.parameters))}",  # ASCII, and one line whatever the names hold
        f"element vertex {len(table)}",
        *(f"property float {name}" for name in table.dtype.names or ()),
        "end_header",
    )
    return "".join(f"{line}\n" for line in header).encode("ascii") + table.tobytes()


def _table(splats: Splats) -> NDArray[Any]:
    """One structured row per Gaussian, (N,)."""
    harmonics = splats.harmonics  # [N, K, 3]
    rest = harmonics[:, 1:].transpose(0, 2, 1).reshape(len(splats), -1)  # [N, 3 (K - 1)], channel by channel
    opacities = splats.opacities.clip(SMALLEST, 1.0 - SMALLEST)
    columns = {
        ("x", "y", "z"): splats.means,
        ("nx", "ny", "nz"): np.zeros((len(splats), 3)),
        _numbered("f_dc", CHANNELS): harmonics[:, 0],
        _numbered("f_rest", rest.shape[1]): rest,
        ("opacity",): (np.log(opacities) - np.log1p(-opacities))[:, None],
        _numbered("scale", 3): np.log(splats.scales),
        _numbered("rot", 4): splats.quats,
    }
    table = np.empty(len(splats), dtype=[(name, "<f4") for names in columns for name in names])
    for names, values in columns.items():
        for name, column in zip(names, values.T, strict=True):
            table[name] = column
    return table


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}_{i}" for i in range(count))
