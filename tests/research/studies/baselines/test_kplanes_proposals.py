import numpy as np
import pytest
import torch

from research.studies.baselines.kplanes_proposals import (
    WeightedSamples,
    interlevel_loss,
    middles,
    proposals_learn,
    proposed,
    sampled,
    sharpness_at,
)


def some_samples(seed: int, count: int, rays: int = 20) -> WeightedSamples:
    """Histograms between 1 and 3, float32."""
    random = np.random.default_rng(seed)
    inner = np.sort(random.uniform(1.0, 3.0, (rays, count - 1)), axis=1)
    borders = np.concatenate([np.full((rays, 1), 1.0), inner, np.full((rays, 1), 3.0)], axis=1)
    weights = random.random((rays, count)) ** 3
    weights /= weights.sum(axis=1, keepdims=True) + random.random((rays, 1))
    return WeightedSamples(torch.from_numpy(borders).float(), torch.from_numpy(weights).float())


def shortfall(proposal: WeightedSamples, final: WeightedSamples) -> np.ndarray:
    """Equation 13 of Mip-NeRF 360 in float64, interval by interval."""
    losses = np.zeros(final.weights.shape)
    for ray, interval in np.ndindex(*losses.shape):
        start, end = final.borders[ray, interval : interval + 2].double()
        starts, ends = proposal.borders[ray, :-1].double(), proposal.borders[ray, 1:].double()
        bound = proposal.weights[ray].double()[(ends > start) & (starts < end)].sum()
        weight = float(final.weights[ray, interval].double())
        losses[ray, interval] = max(0.0, weight - float(bound)) ** 2 / (weight + 1e-7)
    return losses


@pytest.mark.parametrize(("count", "final_count"), [(12, 7), (5, 30), (1, 1), (1, 4), (4, 1)])
def test_interlevel_loss_is_what_proposals_fall_short_of(count: int, final_count: int) -> None:
    proposal, final = some_samples(0, count), some_samples(1, final_count)
    low = WeightedSamples(proposal.borders, 0.3 * proposal.weights)
    expected = shortfall(low, final)
    assert expected.max() > 0.01
    np.testing.assert_allclose(interlevel_loss(low, final), expected, rtol=1e-3, atol=1e-6)


def test_a_proposal_like_the_final_samples_has_no_loss() -> None:
    final = some_samples(2, 9)
    assert interlevel_loss(final, final).max() < 1e-10


def test_only_the_proposal_learns_from_what_it_missed() -> None:
    proposal, final = some_samples(0, 10), some_samples(1, 10)
    proposal = WeightedSamples(proposal.borders, (0.3 * proposal.weights).requires_grad_())
    final.weights.requires_grad_()
    interlevel_loss(proposal, final).sum().backward()
    assert final.weights.grad is None
    assert proposal.weights.grad is not None
    assert proposal.weights.grad.max() <= 1e-6  # more weight is never worse
    assert proposal.weights.grad.min() < -0.1


def test_weights_of_samples_are_of_the_densities_between_their_borders() -> None:
    borders = torch.tensor([[1.0, 1.5, 3.0]])
    np.testing.assert_allclose(middles(borders), [[1.25, 2.25]])
    first = 1.0 - np.exp(-0.4 * 0.5)
    second = np.exp(-0.4 * 0.5) * (1.0 - np.exp(-2.0 * 1.5))
    np.testing.assert_allclose(sampled(borders, torch.tensor([[0.4, 2.0]])).weights, [[first, second]], rtol=1e-6)


NEAR, FAR = torch.tensor([1.0, 2.0]), torch.tensor([3.0, 5.0])


def thin_wall(distances: torch.Tensor) -> torch.Tensor:
    """Dense only between 2.4 and 2.6."""
    return torch.where((distances > 2.4) & (distances < 2.6), 200.0, 0.0)


def test_samples_gather_where_proposals_found_something() -> None:
    found, borders = proposed(NEAR, FAR, [thin_wall, thin_wall], (64, 64, 40))
    assert [tuple(samples.weights.shape) for samples in found] == [(2, 64), (2, 64)]
    assert borders.shape == (2, 41)
    for before, after in zip((found[0].borders, found[1].borders), (found[1].borders, borders), strict=True):
        shares = [((b > 2.35) & (b < 2.65)).float().mean(dim=1) for b in (before, after)]
        assert (shares[1] > 1.2 * shares[0]).all()
    assert (borders.diff(dim=1) >= 0.0).all()


def test_at_first_samples_are_even_whatever_proposals_found() -> None:
    _, borders = proposed(NEAR, FAR, [thin_wall], (64, 40), sharpness=0.0)
    expected = [np.linspace(1.0, 3.0, 41), np.linspace(2.0, 5.0, 41)]
    np.testing.assert_allclose(borders, expected, rtol=1e-5)


def test_samples_are_moved_at_random_only_in_training() -> None:
    def borders(seed: int | None) -> torch.Tensor:
        random = None if seed is None else torch.Generator().manual_seed(seed)
        return proposed(NEAR, FAR, [thin_wall], (16, 8), random=random)[1]

    assert torch.equal(borders(None), borders(None))
    assert torch.equal(borders(1), borders(1))
    assert not torch.equal(borders(1), borders(2))
    assert not torch.equal(borders(1), borders(None))


def test_sharpness_grows_to_one_in_a_thirtieth_of_all_steps() -> None:
    assert sharpness_at(0.0) == 0.0
    assert sharpness_at(100 / 30_001) == pytest.approx(10 * 0.1 / (9 * 0.1 + 1))
    assert sharpness_at(500 / 30_001) == pytest.approx(10 * 0.5 / (9 * 0.5 + 1))
    assert sharpness_at(1000 / 30_001) == pytest.approx(1.0)
    assert sharpness_at(0.5) == sharpness_at(1.0) == 1.0


def learning_steps(steps: int) -> np.ndarray:
    waited, found = 0, []
    for step in range(steps):
        learn = proposals_learn(step / steps, waited)
        found += [step] * learn
        waited = 1 if learn else waited + 1
    return np.array(found)


def test_proposals_learn_ever_more_rarely() -> None:
    """More than 1 to 5 steps after the last time, as the official sampler counts them: every second to every sixth."""
    found = learning_steps(30_001)
    assert found[:10].tolist() == list(range(10))
    waits = np.diff(found)[9:]
    assert (waits[:200] == 2).all()
    assert (np.diff(waits) >= 0).all()
    assert (waits[found[10:] > 5010] == 6).all()
    for wait, start in ((3, 2000), (4, 3000), (5, 4000), (6, 5000)):
        first = found[10:][waits >= wait][0]
        assert start <= first < start + 10


@pytest.mark.parametrize("steps", [1, 2, 7, 100])
def test_proposals_learn_at_the_first_step_of_short_plans(steps: int) -> None:
    assert learning_steps(steps)[0] == 0
    assert len(learning_steps(100)) > 15
