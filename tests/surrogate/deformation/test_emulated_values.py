"""Values that follow an emulated field: as the emulator predicts them, on the carried scale, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from surrogate.appearance.field_gaussians import FieldGaussians, FieldValues
from surrogate.appearance.scale import ValueScale
from surrogate.deformation import BilinearDeformation, compose, load_deformation
from surrogate.deformation.emulated_values import BEYOND, SHARE
from surrogate.settings import TrainingSettings
from surrogate.training.relocation import Relocation, relocate
from tests.support.emulated_values import COUNT, FUNCTION, MEMBERS, SCALE, emulated, processes

SETTINGS = TrainingSettings(latent_size=3, hidden_width=8, seed=3)
PARAMETERS = torch.tensor([0.3, -0.7])


def gaussians() -> FieldGaussians:
    random = torch.Generator().manual_seed(2)
    tensors = {"means": 3, "log_scales": 3, "quats": 4, "values": 2}
    made = {name: torch.randn(COUNT, width, generator=random) for name, width in tensors.items()}
    return FieldGaussians.of_tensors(
        made | {"opacity_logits": torch.randn(COUNT, generator=random)}, FieldValues(FUNCTION, SCALE)
    )


def deformation() -> BilinearDeformation:
    blank = BilinearDeformation.create(gaussians(), 2, SETTINGS)
    random = torch.Generator().manual_seed(4)
    moving = {n: t + 0.1 * torch.randn(t.shape, generator=random) for n, t in blank.tensors().items()}
    return replace(blank.with_tensors(moving), emulated=emulated())


def test_coefficients_are_the_means_of_the_processes() -> None:
    for point in ([0.3, -0.7], processes().points[2].tolist(), [5.0, 5.0]):
        expected, _ = processes().predict(np.array([point]))
        found = emulated().coefficients(torch.tensor(point, dtype=torch.float64))
        np.testing.assert_allclose(found.numpy(), expected[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("scale", [SCALE, None])
def test_values_follow_the_field_on_their_scale(scale: ValueScale | None) -> None:
    values, (coefficients, _) = emulated(scale), processes().predict(PARAMETERS.double().numpy()[None])
    means, modes = values.means.double().numpy(), values.modes.double().numpy()

    def carried(field: np.ndarray) -> np.ndarray:
        return np.clip(field if scale is None else scale.places(field), -BEYOND, 1.0 + BEYOND)

    expected = SHARE * (carried(means + modes @ coefficients[0]) - carried(means))
    np.testing.assert_allclose(values.shifts(PARAMETERS).numpy(), expected, atol=2e-6)
    shifted = values.added_to(gaussians(), PARAMETERS).values
    np.testing.assert_allclose((shifted - gaussians().values)[:, 0].numpy(), expected, atol=2e-6)
    assert torch.equal(shifted[:, 1], gaussians().values[:, 1])


def test_with_and_without_derivatives_values_are_the_same() -> None:
    parameters = PARAMETERS.clone().requires_grad_()
    differentiable = emulated().shifts(parameters)
    assert differentiable.requires_grad
    np.testing.assert_allclose(differentiable.detach().numpy(), emulated().shifts(PARAMETERS).numpy(), atol=1e-6)


def test_derivatives_by_parameters_are_those_of_differences() -> None:
    values = replace(emulated(), means=emulated().means.double(), modes=emulated().modes.double())
    for point in (PARAMETERS.double(), torch.from_numpy(processes().points[1])):
        place = point.clone().requires_grad_()
        weights = torch.linspace(-1.0, 1.0, COUNT, dtype=torch.float64)
        (values.shifts(place) @ weights).backward()
        assert place.grad is not None
        for axis in range(2):
            step = torch.zeros(2, dtype=torch.float64)
            step[axis] = 1e-6
            ahead, behind = (float(values.shifts(point + s) @ weights) for s in (step, -step))
            assert float(place.grad[axis]) == pytest.approx((ahead - behind) / 2e-6, rel=1e-4, abs=1e-6)


def test_the_kernel_adds_offsets_to_values_that_follow() -> None:
    moving, still = deformation(), gaussians()
    by_kernel = moving.deformed(still, PARAMETERS)
    exact = moving.to(torch.float64).deformed(still.to(torch.float64), PARAMETERS.double())
    for name, tensor in by_kernel.tensors().items():
        np.testing.assert_allclose(tensor.numpy(), exact.tensors()[name].numpy(), atol=1e-5, err_msg=name)
    alone = replace(moving, emulated=None)
    assert not torch.allclose(by_kernel.tensors()["values"], alone.deformed(still, PARAMETERS).tensors()["values"])
    twice = compose(still, (moving, PARAMETERS), (alone, PARAMETERS)).tensors()
    for name, tensor in alone.deformed(by_kernel, PARAMETERS).tensors().items():
        np.testing.assert_allclose(twice[name].numpy(), tensor.numpy(), atol=1e-5, err_msg=name)


def test_training_leaves_the_emulator_as_it_is() -> None:
    moving, carriers = deformation(), gaussians()
    leaves = {name: tensor.requires_grad_() for name, tensor in moving.tensors().items()}
    moving.deformed(carriers, PARAMETERS).values.sum().backward()  # type: ignore[union-attr]
    assert leaves["emulated_means"].grad is None
    assert leaves["emulated_modes"].grad is None
    assert leaves["latents"].grad is not None
    assert set(moving.rates(SETTINGS)) == set(leaves)


def test_rows_move_with_their_gaussians() -> None:
    moving = deformation()
    rows = torch.tensor([7, 3, 11])
    some = moving.of(rows)
    assert some.emulated is not None
    for name in moving.per_gaussian:
        assert torch.equal(some.tensors()[name], moving.tensors()[name][rows]), name
    copied = moving.copy()
    tensors = {
        **{n: t for n, t in copied.tensors().items() if n in copied.per_gaussian},
        **gaussians().copy().tensors(),
    }
    relocate(Relocation(torch.tensor([0]), torch.tensor([9]), torch.tensor([2])), tensors, {})
    assert torch.equal(tensors["emulated_modes"][0], moving.tensors()["emulated_modes"][9])


def test_stored_it_is_read_again() -> None:
    moving = deformation()
    loaded = load_deformation(moving.stored(), moving.record())
    for name, tensor in moving.deformed(gaussians(), PARAMETERS).tensors().items():
        assert torch.equal(loaded.deformed(gaussians(), PARAMETERS).tensors()[name], tensor), name
    assert moving.without("values").emulated is None
    assert deformation().reduced(2, [PARAMETERS]).emulated is not None


DAMAGES = {
    "fewer means": ({"emulated_means": torch.zeros(COUNT, 1)}, {}, r"emulated_means must be \(N,\)"),
    "other modes": ({"emulated_modes": torch.zeros(COUNT, 5)}, {}, "5 groups"),
    "long lengths": ({"emulated_lengths": torch.full((2, 2), 1e6)}, {}, "lengths must lie in"),
    "other groups": ({}, {"groups": [0, 0, 1, 7]}, "groups must be whole numbers below 2"),
    "too large a share": ({}, {"share": 1.5}, "share must lie in"),
    "no increasing knots": ({}, {"knots": [1.0, 0.0]}, "at least two increasing numbers"),
    "one parameter": (
        {"emulated_points": torch.zeros(MEMBERS, 1), "emulated_lengths": torch.ones(2, 1)},
        {},
        "parameters of",
    ),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_named(damage: str) -> None:
    tensors, changes, message = DAMAGES[damage]
    moving = deformation()
    record = moving.record()
    with pytest.raises(ValueError, match=message):
        load_deformation({**moving.stored(), **tensors}, {**record, "emulated": {**record["emulated"], **changes}})
