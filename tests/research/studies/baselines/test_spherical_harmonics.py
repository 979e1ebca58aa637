import numpy as np
import torch
from scipy.special import sph_harm_y

from research.studies.baselines.spherical_harmonics import COUNT, harmonics


def test_harmonics_are_orthonormal_over_the_sphere() -> None:
    heights, areas = np.polynomial.legendre.leggauss(8)  # exact up to degree 15
    azimuths = 2.0 * np.pi * np.arange(16) / 16
    across = np.sqrt(1.0 - heights**2)[:, None]
    points = np.broadcast_arrays(across * np.cos(azimuths), across * np.sin(azimuths), heights[:, None])
    values = harmonics(torch.from_numpy(np.stack(points, axis=-1))).numpy()  # [8, 16, 16]
    products = np.einsum("i,ijk,ijl->kl", areas * 2.0 * np.pi / 16, values, values)
    np.testing.assert_allclose(products, np.eye(COUNT), atol=1e-12)


def test_order_and_signs_are_those_of_real_harmonics_with_the_condon_shortley_phase() -> None:
    """Scipy's complex harmonics have that phase; the real one of order m < 0 is its imaginary part, else its real part."""
    random = np.random.default_rng(0)
    points = random.normal(size=(50, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    polar, azimuth = np.arccos(points[:, 2]), np.arctan2(points[:, 1], points[:, 0])
    expected = []
    for degree in range(4):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), polar, azimuth)
            part = value.imag if order < 0 else value.real
            expected.append(part * (np.sqrt(2.0) if order else 1.0))
    np.testing.assert_allclose(harmonics(torch.from_numpy(points)), np.stack(expected, axis=1), atol=1e-12)


def test_values_along_the_axes_are_those_of_gaussian_splatting() -> None:
    """Kerbl et al. 2023, official `sh_utils.py`: C0 = 0.28209479, C1 = 0.48860251, C2 from 1.09254843, C3 from -0.59004359."""
    x, y, z = harmonics(torch.eye(3, dtype=torch.float64)).numpy()
    np.testing.assert_allclose(
        x[[0, 3, 6, 8, 13, 15]], [0.28209479, -0.48860251, -0.31539157, 0.54627422, 0.45704580, -0.59004359], atol=1e-8
    )
    np.testing.assert_allclose(
        y[[0, 1, 6, 8, 9, 11]], [0.28209479, -0.48860251, -0.31539157, -0.54627422, 0.59004359, 0.45704580], atol=1e-8
    )
    np.testing.assert_allclose(z[[0, 2, 6, 12]], [0.28209479, 0.48860251, 0.63078313, 0.74635267], atol=1e-8)
    for values, count in ((x, 6), (y, 6), (z, 4)):
        assert np.count_nonzero(np.abs(values) > 1e-12) == count


def test_float32_and_leading_dimensions_are_kept() -> None:
    found = harmonics(torch.nn.functional.normalize(torch.ones(2, 5, 3), dim=-1))
    assert (found.shape, found.dtype) == ((2, 5, COUNT), torch.float32)
