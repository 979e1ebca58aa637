import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from surrogate.training.optimizer import Adam, Moments
from surrogate.training.relocation import plan_relocation, relocate, share


def transmittance_along_centre(opacity: float, scale: float, copies: int, places: np.ndarray) -> np.ndarray:
    """The transmittance of one ray per place through `copies` equal Gaussians in one dimension, one over the other."""
    return (1.0 - opacity * np.exp(-0.5 * (places / scale) ** 2)) ** copies


@pytest.mark.parametrize("copies", [1, 2, 5, 16])
@pytest.mark.parametrize("opacity", [0.05, 0.5, 0.95])
def test_sharing_keeps_the_centre_and_the_total_light(copies: int, opacity: float) -> None:
    logit = torch.logit(torch.tensor([opacity], dtype=torch.float64)).float()
    logits, log_scales = share(logit, torch.zeros(1, 3), torch.tensor([copies]))
    each, scale = float(logits.double().sigmoid()), float(log_scales[0, 0].double().exp())
    places = np.linspace(-12.0, 12.0, 4001)
    before = 1.0 - transmittance_along_centre(opacity, 1.0, 1, places)
    after = 1.0 - transmittance_along_centre(each, scale, copies, places)
    assert abs(after[2000] - before[2000]) < 1e-5
    assert abs(after.sum() / before.sum() - 1.0) < 1e-4


@pytest.mark.parametrize("logit", [-600.0, -100.0, -40.0, -36.0, -20.0, -14.0])
def test_what_is_next_to_nothing_is_shared_in_equal_parts(logit: float) -> None:
    """In the canonical Gaussians, of one that is there in some members: log scales became inf, or its logit jumped to -13.8."""
    logits, log_scales = share(torch.full((3,), logit), torch.zeros(3, 3), torch.tensor([2, 5, 16]))
    parts = logit - torch.tensor([2.0, 5.0, 16.0]).log()
    torch.testing.assert_close(logits, parts, rtol=1e-6, atol=0.0)
    torch.testing.assert_close(log_scales, torch.zeros(3, 3), rtol=0.0, atol=1e-5)


@pytest.mark.parametrize("logit", [17.0, 40.0, 1000.0])
def test_what_is_opaque_is_shared_by_its_optical_depth(logit: float) -> None:
    logits, log_scales = share(torch.full((2,), logit), torch.zeros(2, 3), torch.tensor([2, 16]))
    depths = torch.nn.functional.softplus(logits.double())
    torch.testing.assert_close(depths, torch.tensor([logit / 2, logit / 16]).double(), rtol=1e-6, atol=0.0)
    assert bool(log_scales.isfinite().all())


def test_what_is_nothing_at_all_stays_finite() -> None:
    shared = share(torch.tensor([-1e4]), torch.zeros(1, 3), torch.tensor([2]))
    assert all(bool(found.isfinite().all()) for found in shared)


def test_the_dead_move_onto_the_living_in_proportion_to_opacity() -> None:
    peaks = torch.cat([torch.full((1000,), 0.6), torch.full((1000,), 0.2), torch.full((2000,), 0.001)])
    relocation = plan_relocation(peaks, np.random.default_rng(0))
    assert relocation is not None
    assert set(relocation.moved.tolist()) == set(range(2000, 4000))
    assert abs(float((relocation.sources < 1000).double().mean()) - 0.75) < 0.03
    assert int(relocation.sources.max()) < 2000


@pytest.mark.parametrize("opacity", [0.011, 0.019, 0.021, 0.05, 0.3, 0.999, 1.0])
def test_nobody_is_shared_out_until_dead_again(opacity: float) -> None:
    peaks = torch.cat([torch.full((7,), opacity), torch.zeros(500)])
    relocation = plan_relocation(peaks, np.random.default_rng(3))
    most = min(16, max(1, int(np.log1p(-min(opacity, 1.0 - 1e-6)) / np.log1p(-0.02))))  # of the opacity that they share
    if most == 1:
        assert relocation is None
        return
    assert relocation is not None
    counts = np.bincount(relocation.sources.numpy(), minlength=7)
    assert counts.max() == most - 1
    assert torch.equal(relocation.sharing, torch.from_numpy(1 + counts)[relocation.sources])
    logits, _ = share(
        torch.logit(peaks[relocation.sources], eps=1e-6), torch.zeros(len(relocation.sources), 3), relocation.sharing
    )
    assert float(logits.sigmoid().min()) >= 0.0199


@pytest.mark.parametrize("peaks", [torch.full((5,), 0.5), torch.zeros(5)], ids=["none dead", "none alive"])
def test_nothing_moves_without_dead_or_without_living(peaks: torch.Tensor) -> None:
    assert plan_relocation(peaks, np.random.default_rng(0)) is None


def test_relocation_copies_rows_and_second_moments_and_steps_and_forgets_first_ones() -> None:
    count = 6
    rows = {
        "opacity_logits": torch.linspace(-1.0, 1.0, count),
        "log_scales": torch.zeros(count, 3),
        "latents": torch.arange(2.0 * count).view(count, 2),
    }
    before = {name: tensor.clone() for name, tensor in rows.items()}
    moments = {
        name: Moments(torch.ones_like(tensor), 1.0 + torch.rand_like(tensor), torch.arange(1.0, 1.0 + count))
        for name, tensor in rows.items()
    }
    squares = {name: kept.second.clone() for name, kept in moments.items()}
    relocation = plan_relocation(torch.tensor([0.0, 0.9, 0.9, 0.0, 0.9, 0.9]), np.random.default_rng(2))
    assert relocation is not None
    relocate(relocation, rows, moments)
    touched = set(relocation.moved.tolist()) | set(relocation.sources.tolist())
    for row in range(count):
        for name, tensor in rows.items():
            assert (moments[name].first[row] == (0.0 if row in touched else 1.0)).all()
            assert row in relocation.moved or torch.equal(moments[name].second[row], squares[name][row])
            assert row in relocation.moved or moments[name].steps[row] == 1.0 + row
            assert row in touched or torch.equal(tensor[row], before[name][row])
    for moved, source in zip(relocation.moved.tolist(), relocation.sources.tolist(), strict=True):
        assert all(torch.equal(tensor[moved], tensor[source]) for tensor in rows.values())
        assert torch.equal(rows["latents"][moved], before["latents"][source])
        assert all(torch.equal(moments[name].second[moved], squares[name][source]) for name in rows)
        assert all(moments[name].steps[moved] == 1.0 + source for name in rows)
        assert rows["opacity_logits"][moved] < before["opacity_logits"][source]


def test_no_step_after_a_relocation_is_much_longer_than_those_before() -> None:
    """With second moments of zero it was 6.6 times the rate: training of Nyx drifted to infinite scales in 20,000 steps."""
    count, rate = 200, 0.01
    rows = {
        "opacity_logits": torch.zeros(count),
        "log_scales": torch.zeros(count, 3),
        "latents": torch.zeros(count, 4),
    }
    gradients = {name: torch.Generator().manual_seed(place) for place, name in enumerate(rows)}
    adam = Adam(rows, dict.fromkeys(rows, rate))

    def longest_step() -> float:
        before = {name: tensor.clone() for name, tensor in rows.items()}
        for name, tensor in rows.items():
            tensor.grad = 1e-6 * (1.0 + torch.randn(tensor.shape, generator=gradients[name]))
        adam.step(1.0)
        return max(float((tensor - before[name]).abs().max()) for name, tensor in rows.items())

    usual = max([longest_step() for _ in range(2000)][1000:])
    peaks = torch.where(torch.arange(count) < 50, 0.0, 0.5)
    relocation = plan_relocation(peaks, np.random.default_rng(0))
    assert relocation is not None
    with torch.no_grad():
        relocate(relocation, rows, adam.moments())
    assert usual < 2.5 * rate
    assert max(longest_step() for _ in range(100)) < 1.2 * usual


CAMERA = Camera.look_at([0.4, -3.0, 2.0], [0.1, 0.0, -0.2], vertical_fov_degrees=30, width=64, height=48)


def seen(camera: Camera, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) and depths (N,) of places (N, 3)."""
    pixels, depths = camera.project(places)
    return pixels, depths
