import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from surrogate.gaussians import Gaussians, Normalization


def some_gaussians(count: int, degree: int) -> Gaussians:
    torch.manual_seed(0)
    columns = 3 * (degree + 1) ** 2
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, columns))
    return Gaussians(*(torch.randn(shape, dtype=torch.float64) for shape in shapes))


@pytest.mark.parametrize("offset", [0.0, 1e6, -3e8])
def test_a_normalized_camera_sees_normalized_points_where_the_camera_sees_world_points(offset: float) -> None:
    low = np.array([offset, offset + 1.0, offset - 2.0])
    normalization = Normalization.of_box((low, low + np.array([4.0, 2.0, 1.0])))
    random = np.random.default_rng(1)
    world = low + random.random((20, 3)) * [4.0, 2.0, 1.0]
    camera = Camera.look_at(low + np.array([9.0, 7.0, 5.0]), low + 1.0, vertical_fov_degrees=30, width=64, height=48)
    expected, depths = camera.project(world)
    pixels, normalized_depths = normalization.camera(camera).project(normalization.points(world))
    # float64 itself resolves 6e-8 at 3e8, which is 1e-6 pixels here
    np.testing.assert_allclose(pixels, expected, atol=1e-9 + 1e-14 * abs(offset))
    np.testing.assert_allclose(normalized_depths * normalization.extent, depths, atol=1e-9 + 1e-15 * abs(offset))
    assert np.abs(normalization.points(world)).max() <= 1.0 + 1e-6


@pytest.mark.parametrize("bounds", [((0, 0, 0), (0, 0, 0)), ((0, 0, 0), (np.inf, 1, 1)), ((1, 1, 1), (0, 0, 0))])
def test_a_box_without_size_is_refused(bounds: object) -> None:
    with pytest.raises(ValueError, match="box of the volume"):
        Normalization.of_box(bounds)  # type: ignore[arg-type]


def test_colors_of_degree_one_are_the_real_spherical_harmonics() -> None:
    from scipy.special import sph_harm_y

    gaussians, position = some_gaussians(30, degree=1), torch.tensor([3.0, -2.0, 1.0], dtype=torch.float64)
    direction = (gaussians.means - position).numpy()
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    theta, phi = np.arccos(direction[:, 2]), np.arctan2(direction[:, 1], direction[:, 0])

    def real(order: int) -> NDArray[np.float64]:
        # 3DGS drops the Condon-Shortley phase of neither scipy nor the real form: -y, z, -x
        harmonic = sph_harm_y(1, abs(order), theta, phi)
        return harmonic.real if order == 0 else np.sqrt(2.0) * (harmonic.imag if order < 0 else harmonic.real)

    coefficients = gaussians.colors.numpy().reshape(30, 4, 3)
    expected = coefficients[:, 0] + sum(real(m)[:, None] * coefficients[:, 2 + m] for m in (-1, 0, 1))
    np.testing.assert_allclose(gaussians.colors_from(position).numpy(), expected, atol=1e-12)


def test_colors_of_degree_zero_do_not_depend_on_the_view() -> None:
    gaussians = some_gaussians(5, degree=0)
    torch.testing.assert_close(gaussians.colors_from(torch.zeros(3, dtype=torch.float64)), gaussians.colors)


def test_activations() -> None:
    gaussians = some_gaussians(9, degree=0)
    np.testing.assert_allclose(gaussians.scales().numpy(), np.exp(gaussians.log_scales.numpy()))
    np.testing.assert_allclose(gaussians.opacities().numpy(), 1 / (1 + np.exp(-gaussians.opacity_logits.numpy())))
