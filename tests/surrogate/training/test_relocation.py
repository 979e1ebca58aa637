from dataclasses import replace

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings
from surrogate.training.loop import LoopMemory, StageRun
from surrogate.training.optimizer import Adam, Moments
from surrogate.training.relocation import ScreenGradients, plan_relocation, relocate, share
from surrogate.training.source import Source
from surrogate.training.stages import canonical_stage, simulation_stage
from tests.support.visualizations import base


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
    relocation = plan_relocation(peaks, 0.01, np.random.default_rng(0))
    assert relocation is not None
    assert set(relocation.moved.tolist()) == set(range(2000, 4000))
    assert abs(float((relocation.sources < 1000).double().mean()) - 0.75) < 0.03
    assert int(relocation.sources.max()) < 2000


@pytest.mark.parametrize("opacity", [0.011, 0.019, 0.021, 0.05, 0.3, 0.999, 1.0])
def test_nobody_is_shared_out_until_dead_again(opacity: float) -> None:
    peaks = torch.cat([torch.full((7,), opacity), torch.zeros(500)])
    relocation = plan_relocation(peaks, 0.01, np.random.default_rng(3))
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
    assert plan_relocation(peaks, 0.01, np.random.default_rng(0)) is None


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
    relocation = plan_relocation(torch.tensor([0.0, 0.9, 0.9, 0.0, 0.9, 0.9]), 0.01, np.random.default_rng(2))
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


def test_the_dead_move_to_where_they_are_wanted_in_proportion() -> None:
    peaks = torch.cat([torch.full((1000,), 0.9), torch.full((1000,), 0.5), torch.full((2000,), 0.001)])
    wanted = torch.zeros(4000)
    wanted[:500], wanted[1000:1500], wanted[2000:2100] = 1.0, 3.0, 9.0  # the last are dead themselves
    relocation = plan_relocation(peaks, 0.01, np.random.default_rng(0), wanted)
    assert relocation is not None
    sources = relocation.sources
    assert bool(((sources < 500) | ((sources >= 1000) & (sources < 1500))).all())
    assert abs(float((sources < 500).double().mean()) - 0.25) < 0.03


@pytest.mark.parametrize(
    "wanted", [torch.zeros(40), torch.cat([torch.zeros(20), torch.ones(20)])], ids=["none", "dead"]
)
def test_where_nothing_alive_is_wanted_opacity_decides(wanted: torch.Tensor) -> None:
    peaks = torch.cat([torch.full((20,), 0.6), torch.zeros(20)])
    found, expected = (plan_relocation(peaks, 0.01, np.random.default_rng(1), w) for w in (wanted, None))
    assert found is not None
    assert expected is not None
    assert torch.equal(found.sources, expected.sources)
    assert torch.equal(found.moved, expected.moved)


def test_one_that_is_wanted_is_not_crowded_and_the_others_stay() -> None:
    peaks, wanted = torch.cat([torch.full((10,), 0.9), torch.zeros(300)]), torch.zeros(310)
    wanted[4] = 1e-4
    relocation = plan_relocation(peaks, 0.01, np.random.default_rng(1), wanted)
    assert relocation is not None
    assert relocation.sources.tolist() == [4] * 15
    assert relocation.sharing.tolist() == [16] * 15


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
    relocation = plan_relocation(peaks, 0.01, np.random.default_rng(0))
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


def test_a_pull_is_the_gradient_per_device_coordinate() -> None:
    """A loss that is linear in where Gaussians are seen; its gradient in space by finite differences in float64."""
    axis = CAMERA.rotation[2]  # what lies on the camera's axis is seen without a change of scale
    means = CAMERA.position + np.array([[2.0], [3.5], [5.0]]) * axis
    by_pixel = np.array([[0.3, -0.4], [2.0, 0.0], [0.0, 0.01]])  # the loss's, per pixel
    gradients, step = np.zeros((3, 3)), 1e-5
    for c in range(3):
        moved = np.eye(3)[c] * step
        difference = (seen(CAMERA, means + moved)[0] - seen(CAMERA, means - moved)[0]) / (2.0 * step)
        gradients[:, c] = (by_pixel * difference).sum(axis=1)
    pulls = ScreenGradients.none(3, torch.zeros(1))
    pulls.add(torch.from_numpy(means).float(), torch.from_numpy(gradients).float(), CAMERA)
    expected = np.linalg.norm(by_pixel, axis=1) * CAMERA.width / 2.0  # device coordinates are width / 2 pixels
    np.testing.assert_allclose(pulls.totals.numpy(), expected, rtol=1e-4)
    assert pulls.pictures.tolist() == [1.0, 1.0, 1.0]


def test_means_are_over_pictures_that_showed_the_gaussian() -> None:
    pulls, means = ScreenGradients.none(3, torch.zeros(1)), torch.zeros(3, 3)
    for first, second in ((1.0, 0.0), (3.0, 4.0)):
        pulls.add(means, torch.tensor([[first, 0, 0], [0, second, 0], [0, 0, 0]]), CAMERA)
    once = ScreenGradients.none(1, torch.zeros(1))
    once.add(means[:1], torch.tensor([[1.0, 0, 0]]), CAMERA)
    unit = float(once.totals)
    expected = torch.tensor([2.0, 4.0, 0.0]) * unit
    torch.testing.assert_close(pulls.above(0.0), expected)
    torch.testing.assert_close(pulls.above(3.0 * unit), torch.tensor([0.0, 4.0, 0.0]) * unit)


def test_no_gradient_counts_nothing_and_what_is_forgotten_is_gone() -> None:
    pulls = ScreenGradients.none(2, torch.zeros(1))
    pulls.add(torch.zeros(2, 3), None, CAMERA)
    assert not pulls.pictures.any()
    pulls.add(torch.zeros(2, 3), torch.ones(2, 3), CAMERA)
    assert pulls.above(0.0).all()
    pulls.forget()
    assert not pulls.totals.any()
    assert not pulls.pictures.any()


def test_the_state_can_be_taken_up_again() -> None:
    first, second = ScreenGradients.none(4, torch.zeros(1)), ScreenGradients.none(4, torch.zeros(1))
    first.add(torch.rand(4, 3), torch.rand(4, 3), CAMERA)
    for name, tensor in second.tensors().items():
        tensor.copy_(first.tensors()[name])
    assert torch.equal(second.above(0.0), first.above(0.0))
    assert len(second.totals) == 4


def screen_gradients_of(run: StageRun) -> ScreenGradients:
    assert run._screen_gradients is not None
    return run._screen_gradients


@pytest.mark.parametrize("stage", ["canonical", "deformation"])
def test_dead_gaussians_move_to_where_pictures_pull(make_catalog, stage: str) -> None:
    """Of the blobs all but one are as they should be: those that lie dead move onto that one."""
    settings = TrainingSettings(
        relocation_interval=12,
        relocation_target="gradient",
        relocation_stop=1.0,
        canonical_steps=12,
        deformation_steps=12,
    )
    catalog = make_catalog(members=(("train", 0.5),), view_splits=("train",) * 12)
    fitted = base()
    gaussians = fitted.gaussians.of(torch.tensor([*range(12), 11, 11, 11]))
    gaussians.means[2] += 0.15
    gaussians.opacity_logits[12:] = -9.0
    still = replace(fitted.deformation, weights_out=torch.zeros_like(fitted.deformation.weights_out))
    still = replace(still, biases_out=torch.zeros_like(still.biases_out)).of(torch.tensor([*range(12), 11, 11, 11]))
    made = (
        canonical_stage(gaussians, settings) if stage == "canonical" else simulation_stage(gaussians, still, settings)
    )
    rates = dict.fromkeys(made.rates, 0.0)
    run = StageRun(replace(made, rates=rates), settings, Source(settings, catalog).data())
    before = gaussians.means.detach().clone()
    strongest = []
    for step in range(12):
        if step == 11:
            strongest = screen_gradients_of(run).above(0.0).topk(1).indices.tolist()
        run.advance()
    assert strongest == [2]
    moved = (gaussians.means.detach() - before).abs().sum(dim=1).nonzero().flatten().tolist()
    assert set(moved) <= {12, 13, 14}
    assert not screen_gradients_of(run).totals.any()  # begun anew


def test_a_run_by_gradient_and_hard_examples_goes_on_bit_for_bit(make_catalog) -> None:
    settings = TrainingSettings(
        gaussians=40, relocation_interval=7, relocation_target="gradient", hard_example_power=1.0, canonical_steps=230
    )
    source = Source(settings, make_catalog(view_splits=("train",) * 4))
    data = source.data()

    def fresh(gaussians: Gaussians, memory: LoopMemory | None = None) -> StageRun:
        return StageRun(canonical_stage(gaussians, settings), settings, data, memory)

    first = source.initial_gaussians(data)
    first.opacity_logits[::3] = -7.0  # so that something is relocated
    whole, parts = fresh(first.copy()), fresh(first.copy())
    for _ in range(115):
        whole.advance()
    for end in (20, 99, 100, 101, 115):
        while parts.step < end:
            parts.advance()
        memory = parts.memory()
        kept = {name: tensor.detach().clone() for name, tensor in memory.tensors.items()}
        parts = fresh(Gaussians(**parts.stage.tensors).copy(), LoopMemory(memory.step, kept))
    found, expected = ({**run.stage.tensors, **run.memory().tensors} for run in (parts, whole))
    assert found.keys() == expected.keys()
    for name, tensor in expected.items():
        assert found[name].detach().numpy().tobytes() == tensor.detach().numpy().tobytes(), name
