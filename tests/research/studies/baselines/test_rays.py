import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from research.studies.baselines.method import TrainingImages
from research.studies.baselines.rays import PixelSampler, Rays, all_rays, crossings

HEIGHT, WIDTH = 5, 7
BOX = np.array([[-1.0, -0.5, 0.0], [1.0, 0.5, 3.0]])


def skewed_camera(number: int) -> Camera:
    """Neither square nor centred, and another one for each number."""
    look = Camera.look_at(
        (3.0 + number, -2.0, 1.5 * number), (0.1, 0.2, number), vertical_fov_degrees=40, width=WIDTH, height=HEIGHT
    )
    return Camera(look.world_to_camera, 6.0 + number, 5.0, 3.1, 2.0 - 0.3 * number, WIDTH, HEIGHT)


def told_apart() -> TrainingImages:
    """Six pictures, the pixels of which say which picture, row and column they are; parameters and views differ, too."""
    number, row, column = np.indices((6, HEIGHT, WIDTH))
    return TrainingImages(
        np.stack([number, row, column, 40 * number], axis=-1).astype(np.uint8),
        [skewed_camera(view) for view in range(3)],
        views=torch.tensor([2, 0, 1, 1, 2, 0]),
        parameters=torch.arange(12.0).reshape(6, 2) / 12.0,
        box=torch.from_numpy(BOX).float(),
    )


def test_drawn_pixels_come_with_the_camera_s_own_rays_and_their_parameters() -> None:
    pictures = told_apart()
    batch = PixelSampler(pictures).draw(200, torch.Generator().manual_seed(0))
    numbers, rows, columns, _ = (batch.pixels * 255.0).round().int().T
    assert batch.pixels.dtype == torch.float32
    torch.testing.assert_close(batch.parameters, pictures.parameters[numbers])
    for i in range(200):
        origin, directions = pictures.camera(int(numbers[i])).rays()
        np.testing.assert_allclose(batch.rays.origins[i], origin, atol=1e-6)
        np.testing.assert_allclose(batch.rays.directions[i], directions[rows[i], columns[i]], atol=1e-6)


def test_all_pixels_are_drawn_alike() -> None:
    drawn = PixelSampler(told_apart()).draw(21_000, torch.Generator().manual_seed(1)).pixels[:, :3]
    numbers, rows, columns = (drawn * 255.0).round().long().T
    counts = torch.bincount((numbers * HEIGHT + rows) * WIDTH + columns, minlength=6 * HEIGHT * WIDTH)
    assert len(counts) == 6 * HEIGHT * WIDTH
    squares = ((counts - 100.0) ** 2 / 100.0).sum()  # chi-squared of 209 degrees of freedom: 209 +- 20
    assert 130.0 < squares < 300.0


def test_the_same_seed_draws_the_same_pixels() -> None:
    def pixels(seed: int) -> torch.Tensor:
        return PixelSampler(told_apart()).draw(50, torch.Generator().manual_seed(seed)).pixels

    assert torch.equal(pixels(3), pixels(3))
    assert not torch.equal(pixels(3), pixels(4))


def test_all_rays_are_the_camera_s_row_by_row() -> None:
    camera = skewed_camera(1)
    origin, directions = camera.rays()
    rays = all_rays(camera)
    np.testing.assert_allclose(rays.origins, np.tile(origin, (HEIGHT * WIDTH, 1)), atol=1e-6)
    np.testing.assert_allclose(rays.directions.reshape(HEIGHT, WIDTH, 3), directions, atol=1e-6)


@pytest.mark.parametrize(
    ("origin", "direction", "expected"),
    [
        ((-3.0, 0.1, 1.0), (1.0, 0.0, 0.0), (2.0, 4.0)),
        ((-3.0, 0.1, 1.0), (1.0, -0.0, -0.0), (2.0, 4.0)),
        ((0.2, 0.1, 5.0), (0.0, 0.0, -1.0), (2.0, 5.0)),
        ((0.0, -4.5, 1.0), (0.0, 1.0, 0.0), (4.0, 5.0)),
        ((0.5, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.5)),
        ((0.5, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, 1.5)),
        ((-2.0, -1.5, 1.0), (0.6, 0.8, 0.0), (5.0 / 3.0, 2.5)),
        ((-2.0, 0.0, -1.0), (0.6, 0.0, 0.8), (5.0 / 3.0, 5.0)),
    ],
    ids=["along x", "with negative zeros", "down z", "along y", "from inside", "from inside, back", "edge", "slant"],
)
def test_crossings_of_rays_that_hit_the_box(
    origin: tuple[float, ...], direction: tuple[float, ...], expected: tuple[float, float]
) -> None:
    near, far = crossings(Rays(torch.tensor([origin]), torch.tensor([direction])), torch.from_numpy(BOX).float())
    np.testing.assert_allclose([near.item(), far.item()], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ((-3.0, 0.1, 1.0), (-1.0, 0.0, 0.0)),
        ((-3.0, 2.0, 1.0), (1.0, 0.0, 0.0)),
        ((-3.0, 0.0, 1.0), (0.6, 0.8, 0.0)),
        ((-3.0, 0.0, 9.0), (1.0, 0.0, 0.0)),
        ((-3.0, 0.0, -9.0), (1.0, 0.0, 0.0)),
    ],
    ids=["away", "beside", "across", "far above", "far below"],
)
def test_crossings_of_rays_that_miss_the_box_are_one_finite_distance(
    origin: tuple[float, ...], direction: tuple[float, ...]
) -> None:
    near, far = crossings(Rays(torch.tensor([origin]), torch.tensor([direction])), torch.from_numpy(BOX).float())
    assert near.item() == far.item() >= 0.0
    assert np.isfinite(far.item())


def clipped(origin: np.ndarray, direction: np.ndarray) -> tuple[float, float]:
    """Liang-Barsky clipping of a ray, in float64, half-space by half-space."""
    low, high = 0.0, np.inf
    for axis in range(3):
        for sign, border in ((-1.0, BOX[0, axis]), (1.0, BOX[1, axis])):
            speed, room = sign * direction[axis], sign * (border - origin[axis])  # inside while speed * t <= room
            if speed > 0:
                high = min(high, room / speed)
            elif speed < 0:
                low = max(low, room / speed)
    return low, high


def test_crossings_agree_with_clipping_in_float64() -> None:
    random = np.random.default_rng(2)
    origins = random.uniform(-4.0, 4.0, (500, 3)).astype(np.float32)
    directions = random.uniform(BOX[0] - 0.5, BOX[1] + 0.5, (500, 3)) - origins
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    near, far = crossings(Rays(torch.from_numpy(origins), torch.from_numpy(directions)), torch.from_numpy(BOX).float())
    expected = np.array([clipped(o, d) for o, d in zip(origins.astype(float), directions.astype(float), strict=True)])
    hit = expected[:, 1] > expected[:, 0]
    assert 150 < hit.sum() < 450
    clear = np.abs(expected[:, 1] - expected[:, 0]) > 1e-4
    np.testing.assert_array_equal((far > near).numpy()[clear], hit[clear])
    np.testing.assert_allclose(near.numpy()[hit], expected[hit, 0], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(far.numpy()[hit], expected[hit, 1], rtol=1e-4, atol=1e-5)
