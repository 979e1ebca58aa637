from dataclasses import replace
from pathlib import Path

import torch

from surrogate.storage.checkpoints import Checkpoint
from surrogate.training.loop import LoopMemory
from surrogate.training.state import TrainingState
from tests.support.visualizations import base, of_functions, of_isovalue


def through_a_file(state: TrainingState, folder: Path) -> TrainingState:
    state.checkpoint("mark").save(folder)
    found = Checkpoint.load(folder)
    assert found is not None
    assert found.record["fingerprint"] == "mark"
    return TrainingState.load(found)


def bits(tensors: dict[str, torch.Tensor]) -> dict[str, bytes]:
    return {name: tensor.detach().numpy().tobytes() for name, tensor in tensors.items()}


def test_a_state_survives_a_checkpoint_bit_for_bit(tmp_path: Path) -> None:
    fitted = base()
    shown = (of_functions(fitted), of_isovalue(fitted, 1))
    memory = LoopMemory(7, {"moments.first.colors": torch.randn(3, 3), "peaks": torch.tensor([0.0, -0.0, 1e-45])})
    choice, point = {"name": "colour degree", "kept": "1"}, {"stage": "canonical", "psnr": None, "loss": 0.1 + 0.2}
    # So many F_vis that names of one digit begin those of two.
    state = TrainingState(
        fitted, 5, memory, tuple(v.copy() for v in shown * 6), (0.1, 1e-300), (point,), (choice,), 12.5
    )
    found = through_a_file(state, tmp_path)
    assert bits(found.fitted.tensors()) == bits(fitted.tensors())
    assert found.loop is not None
    assert (found.loop.step, bits(dict(found.loop.tensors))) == (7, bits(dict(memory.tensors)))
    for name in ("done", "losses", "curve", "choices"):
        assert getattr(found, name) == getattr(state, name)
    assert len(found.visualizations) == 12
    for one, expected in zip(found.visualizations, state.visualizations, strict=True):
        assert (one.variation, one.color_degree) == (expected.variation, expected.color_degree)
        assert bits(one.stored()) == bits(expected.stored())


def test_between_stages_the_loop_remembers_nothing(tmp_path: Path) -> None:
    found = through_a_file(replace(TrainingState(base()), done=2), tmp_path)
    assert (found.loop, found.done, found.visualizations) == (None, 2, ())


def test_a_copy_shares_no_tensor_that_is_trained() -> None:
    fitted = base()
    state = TrainingState(fitted, visualizations=(of_isovalue(fitted, 1),))
    copy = state.copy()
    for one, other in ((state.fitted, copy.fitted), (state.visualizations[0], copy.visualizations[0])):
        tensors = [
            part.tensors() if part is state.fitted or part is copy.fitted else part.stored() for part in (one, other)
        ]
        assert bits(tensors[0]) == bits(tensors[1])
        assert not {t.data_ptr() for t in tensors[0].values()} & {t.data_ptr() for t in tensors[1].values()}


def test_a_state_is_told_on_one_line() -> None:
    assert "\n" not in repr(TrainingState(base()))
    assert "\n" not in repr(LoopMemory(1, {"peaks": torch.zeros(3, 3)}))
