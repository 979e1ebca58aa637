"""The 16 real spherical harmonics of degree 0 to 3, as 3D Gaussian Splatting and instant-ngp order and sign them."""

from __future__ import annotations

import torch
from torch import Tensor

COUNT = 16
C0 = 0.28209479177387814  # sqrt(1 / (4 pi))
C1 = 0.4886025119029199  # sqrt(3 / (4 pi))
C2 = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
C3 = (0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154, 1.445305721320277)


def harmonics(directions: Tensor) -> Tensor:
    """All 16 at unit `directions` (..., 3), (..., 16).

    Sloan 2013, "Efficient Spherical Harmonic Evaluation", with the Condon-Shortley phase.
    """
    x, y, z = directions.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    return torch.stack(
        [
            torch.full_like(x, C0),
            -C1 * y,
            C1 * z,
            -C1 * x,
            C2[0] * x * y,
            -C2[0] * y * z,
            C2[1] * (2.0 * zz - xx - yy),
            -C2[0] * x * z,
            C2[2] * (xx - yy),
            -C3[0] * y * (3.0 * xx - yy),
            C3[1] * x * y * z,
            -C3[2] * y * (4.0 * zz - xx - yy),
            C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
            -C3[2] * x * (4.0 * zz - xx - yy),
            C3[4] * z * (xx - yy),
            -C3[0] * x * (xx - 3.0 * yy),
        ],
        dim=-1,
    )
