"""One state of a surrogate as a file that other viewers of 3D Gaussians read.

The layout is that of the reference implementation of Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field
Rendering" (`GaussianModel.save_ply`): binary little-endian PLY, one vertex of float32 properties per Gaussian.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.gaussians import Gaussians
from surrogate.model import DeformedGaussians

SH_C0 = 0.28209479177387814  # sqrt(1 / (4 pi)), the real spherical harmonic of degree 0
SH_C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
CHANNELS = 3
NODES = 64  # of the quadrature over how much a surface faces the viewer


def ply_bytes(deformed: DeformedGaussians) -> bytes:
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
    table = _table(deformed)
    header = (
        "ply",
        "format binary_little_endian 1.0",
        f"comment gs-surrogate {json.dumps(dict(deformed.parameters))}",  # ASCII, and one line whatever the names hold
        f"element vertex {len(table)}",
        *(f"property float {name}" for name in table.dtype.names or ()),
        "end_header",
    )
    return "".join(f"{line}\n" for line in header).encode("ascii") + table.tobytes()


def _table(deformed: DeformedGaussians) -> NDArray[Any]:
    """One structured row per Gaussian, (N,)."""
    gaussians = deformed.gaussians
    quats = _array(gaussians.quats)  # [N, 4]
    coefficients = _coefficients(gaussians)  # [N, K, 3]
    rest = coefficients[:, 1:].transpose(0, 2, 1).reshape(len(deformed), -1)  # [N, 3 (K - 1)], channel by channel
    columns = {
        ("x", "y", "z"): deformed.means,
        ("nx", "ny", "nz"): np.zeros((len(deformed), 3)),
        _numbered("f_dc", CHANNELS): (coefficients[:, 0] - 0.5) / SH_C0,
        _numbered("f_rest", rest.shape[1]): rest,
        ("opacity",): _array(gaussians.opacity_logits)[:, None],
        _numbered("scale", 3): _array(gaussians.log_scales) + math.log(deformed.normalization.extent),
        _numbered("rot", 4): quats / np.linalg.norm(quats, axis=1, keepdims=True),
    }
    table = np.empty(len(deformed), dtype=[(name, "<f4") for names in columns for name in names])
    for names, values in columns.items():
        for name, column in zip(names, values.T, strict=True):
            table[name] = column
    return table


def _coefficients(gaussians: Gaussians) -> NDArray[np.float64]:
    """Colours by direction, (N, K, 3): the constant, then the factors of spherical harmonics as the reference has them."""
    colors = _array(gaussians.colors)  # [N, 3 K]
    if gaussians.lighting is None:
        return colors.reshape(len(gaussians), -1, CHANNELS)
    lengths = np.linalg.norm(colors, axis=1, keepdims=True)  # [N, 1]
    x, y, z = (colors / np.maximum(lengths, 1e-30)).T  # [N] each
    harmonics = np.stack([x * y, y * z, 2 * z * z - x * x - y * y, x * z, x * x - y * y], axis=1) * SH_C2  # [N, 5]
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    nodes, weights = (nodes + 1.0) / 2.0, weights / 2.0  # [Q], over cosines from 0 to 1
    facing = torch.from_numpy(lengths * nodes).reshape(-1, 1)  # [N Q, 1]
    shades = gaussians.lighting.colors(facing, torch.ones_like(facing)).numpy().reshape(len(colors), NODES, CHANNELS)
    constant = np.einsum("nqc,q->nc", shades, weights)  # [N, 3]
    second = np.einsum("nqc,q->nc", shades, weights * (1.5 * nodes**2 - 0.5)) * 4.0 * math.pi  # [N, 3], Funk-Hecke
    rest = harmonics[:, :, None] * second[:, None]  # [N, 5, 3]
    return np.concatenate([constant[:, None], np.zeros_like(rest[:, :3]), rest], axis=1)


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}_{i}" for i in range(count))


def _array(tensor: Tensor) -> NDArray[np.float64]:
    return tensor.detach().double().cpu().numpy()
