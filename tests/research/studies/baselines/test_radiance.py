import numpy as np
import pytest
import torch

from research.studies.baselines.radiance import composite, resampled, spaced, weights_of


def some_densities(seed: int, largest: float, rays: int = 40, samples: int = 24) -> tuple[torch.Tensor, torch.Tensor]:
    """Densities and lengths of intervals, float32."""
    random = np.random.default_rng(seed)
    densities = largest * random.random((rays, samples)) ** 4
    return torch.from_numpy(densities).float(), torch.from_numpy(random.uniform(0.01, 0.2, (rays, samples))).float()


def weights_in_float64(densities: torch.Tensor, lengths: torch.Tensor) -> np.ndarray:
    """Alpha compositing from front to back, in float64."""
    alphas = 1.0 - np.exp(-densities.double().numpy() * lengths.double().numpy())
    before = np.cumprod(np.concatenate([np.ones_like(alphas[:, :1]), 1.0 - alphas[:, :-1]], axis=1), axis=1)
    return before * alphas


@pytest.mark.parametrize("density", [0.0, 1e-6, 0.3, 2.0, 40.0])
def test_transmittance_of_a_constant_density_is_the_exponential_of_its_length(density: float) -> None:
    lengths = torch.from_numpy(np.random.default_rng(0).uniform(0.0, 0.3, (5, 30))).float()
    weights = weights_of(torch.full_like(lengths, density), lengths)
    expected = -np.expm1(-density * lengths.double().sum(dim=1).numpy())
    np.testing.assert_allclose(weights.double().sum(dim=1), expected, rtol=2e-6)


@pytest.mark.parametrize("largest", [1e-3, 5.0, 200.0])
def test_weights_are_those_of_alpha_compositing(largest: float) -> None:
    densities, lengths = some_densities(1, largest)
    expected = weights_in_float64(densities, lengths)
    np.testing.assert_allclose(weights_of(densities, lengths), expected, rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(
        weights_of(densities, lengths).sum(dim=1),
        -np.expm1(-(densities.double() * lengths.double()).sum(dim=1).numpy()),
        rtol=1e-5,
    )


def test_what_is_very_dense_hides_what_is_behind_and_nothing_in_front() -> None:
    densities = torch.tensor([[2.0, 1e9, 3.0], [0.0, 1e38, 1e38], [2.0, torch.inf, 3.0]])
    weights = weights_of(densities, torch.full((3, 3), 0.5))
    half_hidden = [1.0 - np.exp(-1.0), np.exp(-1.0), 0.0]
    np.testing.assert_allclose(weights, [half_hidden, [0.0, 1.0, 0.0], half_hidden], atol=1e-6)


def test_intervals_without_length_have_no_weight() -> None:
    lengths = torch.tensor([[0.0, 0.2, 0.0]])
    np.testing.assert_array_equal(weights_of(torch.full((1, 3), 7.0), lengths) > 0.0, [[False, True, False]])


def test_colours_are_summed_with_their_weights() -> None:
    weights = torch.tensor([[0.25, 0.5]])
    colors = torch.tensor([[[1.0, 0.0, 0.4], [0.0, 1.0, 0.4]]])
    np.testing.assert_allclose(composite(weights, colors), [[0.25, 0.5, 0.3, 0.75]], rtol=1e-6)


def test_borders_without_random_numbers_are_evenly_spaced() -> None:
    borders = spaced(torch.tensor([1.0, 2.0]), torch.tensor([3.0, 2.0]), 4)
    np.testing.assert_allclose(borders, [[1.0, 1.5, 2.0, 2.5, 3.0], [2.0] * 5], rtol=1e-6)


def test_jittered_borders_stay_in_order_around_even_ones() -> None:
    near, far = torch.rand(300), 1.0 + torch.rand(300)
    moved = spaced(near, far, 10, torch.Generator().manual_seed(0)) - spaced(near, far, 10)  # [300, 11]
    shifts = (moved / ((far - near) / 10.0)[:, None]).numpy()
    assert (shifts[:, [0, -1]] == 0.0).all()
    assert (np.abs(shifts) < 0.5001).all()
    np.testing.assert_allclose(shifts[:, 1:-1].std(axis=0), 12**-0.5, atol=0.05)
    np.testing.assert_allclose(shifts[:, 1:-1].mean(axis=0), 0.0, atol=0.06)


def quantiles_in_float64(borders: np.ndarray, weights: np.ndarray, quantiles: np.ndarray, padding: float) -> np.ndarray:
    """Places where the cumulative distribution of one ray's histogram reaches the quantiles."""
    padded = weights.astype(np.float64) + padding
    below = np.concatenate([[0.0], np.cumsum(padded)]) / padded.sum()
    return np.interp(quantiles, below, borders.astype(np.float64))


@pytest.mark.parametrize(("padding", "count"), [(0.01, 16), (0.01, 200), (1e-5, 7), (1.0, 1)])
def test_resampled_borders_are_quantiles_of_the_histogram(padding: float, count: int) -> None:
    random = np.random.default_rng(3)
    borders = np.sort(random.uniform(2.0, 5.0, (30, 13)), axis=1).astype(np.float32)
    weights = (random.random((30, 12)) ** 6).astype(np.float32)
    found = resampled(torch.from_numpy(borders), torch.from_numpy(weights), count, padding=padding)
    for ray in range(30):
        expected = quantiles_in_float64(borders[ray], weights[ray], np.linspace(0.0, 1.0, count + 1), padding)
        np.testing.assert_allclose(found[ray], expected, atol=2e-5 / padding**0.3)
    np.testing.assert_array_equal(found[:, [0, -1]], borders[:, [0, -1]])
    assert (np.diff(found) >= 0.0).all()


def test_jitter_shifts_all_quantiles_of_a_ray_together() -> None:
    borders = torch.linspace(0.0, 1.0, 5).expand(400, -1)
    found = resampled(
        borders, torch.ones(400, 4), 8, torch.Generator().manual_seed(1)
    )  # [400, 9], of uniform histograms
    shifts = (found - torch.linspace(0.0, 1.0, 9))[:, 1:-1].numpy()
    np.testing.assert_allclose(shifts, np.broadcast_to(shifts[:, :1], shifts.shape), atol=1e-6)
    assert (np.abs(shifts) <= 0.5001 / 8).all()
    assert shifts.min() < -0.4 / 8 < 0.4 / 8 < shifts.max()
    assert (found >= 0.0).all()
    assert (found <= 1.0).all()


def test_nothing_found_is_sampled_evenly() -> None:
    borders = torch.tensor([[1.0, 1.5, 2.0, 2.5, 3.0]])
    np.testing.assert_allclose(resampled(borders, torch.zeros(1, 4), 8), [np.linspace(1.0, 3.0, 9)], rtol=1e-6)


@pytest.mark.parametrize("full", [0, 2, 4])
def test_one_full_interval_gets_nearly_all_borders(full: int) -> None:
    borders = torch.linspace(0.0, 5.0, 6)[None]
    weights = torch.zeros(1, 5)
    weights[0, full] = 1.0
    found = resampled(borders, weights, 100, padding=1e-4)[0]
    assert ((found >= full) & (found <= full + 1.0)).sum() >= 99
    assert (found[0], found[-1]) == (0.0, 5.0)


def test_a_ray_that_misses_everything_keeps_its_one_distance() -> None:
    found = resampled(torch.full((1, 5), 2.5), torch.zeros(1, 4), 3, torch.Generator().manual_seed(0))
    np.testing.assert_array_equal(found, np.full((1, 4), 2.5))


def test_no_gradient_passes_through_resampling() -> None:
    borders, weights = torch.linspace(0.0, 1.0, 5)[None], torch.ones(1, 4, requires_grad=True)
    assert not resampled(borders, weights, 3).requires_grad
