from pathlib import Path

import torch

from surrogate.storage.checkpoints import Checkpoint
from surrogate.training.varying import Varying
from tests.support.visualizations import base, of_isovalue, visualization


def test_without_a_checkpoint_nothing_is_finished() -> None:
    state = Varying.restored(None)
    assert (state.finished, state.color_degree) == ((), None)


def test_a_checkpoint_of_an_earlier_stage_says_nothing_of_variations() -> None:
    checkpoint = Checkpoint({"run.means": torch.zeros(3, 3)}, {"stage": "deformation"})
    assert Varying.restored(checkpoint).finished == ()


def test_what_is_finished_survives_a_checkpoint_bit_for_bit(tmp_path: Path) -> None:
    fitted = base()
    finished = (visualization("values", fitted), of_isovalue(fitted, 1), visualization("paper", fitted))
    state = Varying(tuple(v.copy() for v in finished * 4), 1)  # so many that names of one digit begin those of two
    others = {"run.visualization.weights": torch.ones(2), "fitted.gaussians.means": torch.zeros(3, 3)}
    Checkpoint({**others, **state.tensors()}, {"varying": state.record()}).save(tmp_path)
    restored = Varying.restored(Checkpoint.load(tmp_path))
    assert restored.color_degree == 1
    assert len(restored.finished) == 12
    for found, expected in zip(restored.finished, state.finished, strict=True):
        assert found.variation == expected.variation
        assert found.color_degree == expected.color_degree
        stored = expected.stored()
        assert found.stored().keys() == stored.keys()
        assert all(torch.equal(tensor, stored[name]) for name, tensor in found.stored().items())
