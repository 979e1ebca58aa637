import numpy as np
import pytest
import torch

from surrogate.densify import plan_relocation, relocate, share


def transmittance_along_centre(opacity: float, scale: float, copies: int, places: np.ndarray) -> np.ndarray:
    """What one ray per place lets through `copies` equal Gaussians in one dimension, drawn one over the other."""
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


def test_the_dead_move_onto_the_living_in_proportion_to_opacity() -> None:
    peaks = torch.full((4000,), 0.001)
    peaks[0], peaks[1] = 0.6, 0.2
    relocation = plan_relocation(peaks, 0.01, np.random.default_rng(0))
    assert relocation is not None
    assert set(relocation.moved.tolist()) == set(range(2, 4000))
    share_of_first = float((relocation.sources == 0).double().mean())
    assert set(relocation.sources.tolist()) == {0, 1}
    assert abs(share_of_first - 0.75) < 0.03


@pytest.mark.parametrize("peaks", [torch.full((5,), 0.5), torch.zeros(5)], ids=["none dead", "none alive"])
def test_nothing_moves_without_dead_or_without_living(peaks: torch.Tensor) -> None:
    assert plan_relocation(peaks, 0.01, np.random.default_rng(0)) is None


def test_relocation_copies_rows_and_forgets_moments() -> None:
    count = 6
    rows = {
        "opacity_logits": torch.linspace(-1.0, 1.0, count),
        "log_scales": torch.zeros(count, 3),
        "latents": torch.arange(2.0 * count).view(count, 2),
    }
    before = {name: tensor.clone() for name, tensor in rows.items()}
    moments = {name: (torch.ones_like(tensor), torch.ones_like(tensor)) for name, tensor in rows.items()}
    relocation = plan_relocation(torch.tensor([0.0, 0.9, 0.9, 0.0, 0.9, 0.9]), 0.01, np.random.default_rng(2))
    assert relocation is not None
    relocate(relocation, rows, moments)
    touched = set(relocation.moved.tolist()) | set(relocation.sources.tolist())
    for row in range(count):
        for name, tensor in rows.items():
            assert all((moment[row] == (0.0 if row in touched else 1.0)).all() for moment in moments[name])
            assert row in touched or torch.equal(tensor[row], before[name][row])
    for moved, source in zip(relocation.moved.tolist(), relocation.sources.tolist(), strict=True):
        assert all(torch.equal(tensor[moved], tensor[source]) for tensor in rows.values())
        assert torch.equal(rows["latents"][moved], before["latents"][source])
        assert rows["opacity_logits"][moved] < before["opacity_logits"][source]
