import math
from dataclasses import replace

import pytest
import torch

from surrogate.deformation import BilinearDeformation, Offsets, load_deformation
from surrogate.deformation.offsets import UNITS
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings
from surrogate.training.optimizer import Adam


def canonical(count: int, color_columns: int, dtype: torch.dtype = torch.float32) -> Gaussians:
    generator = torch.Generator().manual_seed(1)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, color_columns))
    return Gaussians(*(torch.randn(shape, generator=generator, dtype=dtype) for shape in shapes))


def random_deformation(
    gaussians: Gaussians, parameters: int, dtype: torch.dtype, frequencies: int = 0, color_columns: int = 3
) -> BilinearDeformation:
    settings = TrainingSettings(latent_size=5, hidden_width=7, parameter_frequencies=frequencies)
    made = BilinearDeformation.create(gaussians, parameters, settings, color_columns=color_columns)
    generator = torch.Generator().manual_seed(2)
    tensors = {n: torch.randn(t.shape, generator=generator, dtype=dtype) for n, t in made.tensors().items()}
    return BilinearDeformation(**tensors, units=made.units.to(dtype), frequencies=frequencies)


def flat(offsets: Offsets) -> torch.Tensor:
    columns = (offsets.means, offsets.log_scales, offsets.quats, offsets.opacity_logits[:, None], offsets.colors)
    return torch.cat(columns, dim=1)


@pytest.mark.parametrize("parameters", [1, 3])
@pytest.mark.parametrize("color_columns", [3, 12])
def test_it_starts_by_moving_nothing_yet_can_learn(parameters: int, color_columns: int) -> None:
    gaussians = canonical(11, color_columns)
    deformation = BilinearDeformation.create(gaussians, parameters, TrainingSettings())
    for tensor in deformation.tensors().values():
        tensor.requires_grad_()
    offsets = flat(deformation.offsets(gaussians, torch.linspace(-1, 1, parameters)))
    assert offsets.shape == (11, 14)  # how colours depend on the direction stays the same
    assert not offsets.any()
    offsets.sum().backward()
    assert deformation.weights_out.grad is not None
    assert deformation.weights_out.grad.abs().min() > 0


def test_offsets_are_each_latent_times_the_embedding_in_their_units() -> None:
    gaussians = canonical(6, 3, torch.float64)
    deformation = random_deformation(gaussians, 2, torch.float64)
    p = torch.tensor([0.3, -0.8], dtype=torch.float64)
    offsets = flat(deformation.offsets(gaussians, p))
    latent, columns = 5, 14
    units = [UNITS[name] for name in ("means", "log_scales", "quats", "opacity_logits")]
    column_units = [units[0]] * 3 + [units[1]] * 3 + [units[2]] * 4 + [units[3]] + [UNITS["colors"]] * 3
    for i in range(6):
        for c in range(columns):
            expected = 0.0
            for mode in range(latent):
                row = mode * columns + c
                hidden = deformation.weights_in @ p + deformation.biases_in
                hidden = hidden / (1.0 + torch.exp(-hidden))
                middle = deformation.weights_middle @ hidden + deformation.biases_middle
                hidden = hidden + middle / (1.0 + torch.exp(-middle))
                value = float(deformation.weights_out[row] @ hidden + deformation.biases_out[row])
                expected += float(deformation.latents[i, mode]) * value
            assert float(offsets[i, c]) == pytest.approx(expected * column_units[c], rel=1e-6)


@pytest.mark.parametrize("frequencies", [1, 3])
def test_the_network_sees_sines_and_cosines_of_the_parameters(frequencies: int) -> None:
    deformation = random_deformation(canonical(6, 3, torch.float64), 2, torch.float64, frequencies)
    p = [0.3, -0.8]
    turns = [2**k * math.pi * x for x in p for k in range(frequencies)]
    inputs = torch.tensor([*p, *map(math.sin, turns), *map(math.cos, turns)], dtype=torch.float64)
    plain = replace(deformation, frequencies=0)
    torch.testing.assert_close(deformation.embedding(torch.tensor(p, dtype=torch.float64)), plain.embedding(inputs))
    assert deformation.parameters == 2


@pytest.mark.parametrize("frequencies", [0, 2])
def test_gradients_agree_with_finite_differences(frequencies: int) -> None:
    gaussians = canonical(4, 3, torch.float64)
    deformation = random_deformation(gaussians, 3, torch.float64, frequencies)
    names = list(deformation.tensors())

    def offsets(parameters: torch.Tensor, *tensors: torch.Tensor) -> torch.Tensor:
        moved = deformation.with_tensors(dict(zip(names, tensors, strict=True)))
        return flat(moved.offsets(gaussians, parameters))

    inputs = [torch.tensor([0.1, -0.5, 0.9], dtype=torch.float64), *deformation.tensors().values()]
    assert torch.autograd.gradcheck(offsets, [tensor.requires_grad_() for tensor in inputs])


@pytest.mark.parametrize("frequencies", [0, 1])
def test_it_survives_being_saved(frequencies: int) -> None:
    gaussians = canonical(5, 12)
    deformation = random_deformation(gaussians, 2, torch.float32, frequencies)
    loaded = load_deformation(deformation.tensors(), deformation.record())
    p = torch.tensor([0.2, 0.4])
    torch.testing.assert_close(
        flat(loaded.offsets(gaussians, p)), flat(deformation.offsets(gaussians, p)), rtol=0, atol=0
    )


@pytest.mark.parametrize("frequencies", [-1, 9, 1.0, True, "1", 2])
def test_frequencies_that_do_not_fit_are_named(frequencies: object) -> None:
    deformation = random_deformation(canonical(5, 3), 2, torch.float32, 1)
    with pytest.raises(ValueError, match="frequencies must be a whole number from 0 to 8"):
        load_deformation(deformation.stored(), deformation.record() | {"frequencies": frequencies})


def test_an_unknown_kind_is_named() -> None:
    with pytest.raises(ValueError, match="unknown deformation 'warp'"):
        load_deformation({}, {"kind": "warp"})


@pytest.mark.parametrize("count", [0, 1, 7, 1500])
@pytest.mark.parametrize("color_columns", [3, 12])
def test_the_kernel_is_the_definition_forward_and_backward(count: int, color_columns: int) -> None:
    found = {}
    for dtype in (torch.float32, torch.float64):
        gaussians = canonical(count, color_columns, torch.float32)
        deformation = random_deformation(gaussians, 2, torch.float32)
        gaussians = Gaussians(*(t.to(dtype).requires_grad_() for t in gaussians.tensors().values()))
        tensors = {name: t.to(dtype).requires_grad_() for name, t in deformation.tensors().items()}
        deformation = BilinearDeformation(**tensors, units=deformation.units.to(dtype))
        p = torch.tensor([0.3, -0.8], dtype=dtype)
        if dtype == torch.float32:
            deformed = deformation.deformed(gaussians, p)
        else:
            deformed = deformation.offsets(gaussians, p).applied_to(gaussians)
        weights = canonical(count, color_columns, torch.float32)  # of a linear loss
        pairs = zip(deformed.tensors().values(), weights.tensors().values(), strict=True)
        loss = sum((value * weight.to(dtype).sin()).sum() for value, weight in pairs)
        leaves = [*gaussians.tensors().values(), *tensors.values()]
        found[dtype] = [*deformed.tensors().values(), *torch.autograd.grad(loss, leaves)]
    for fast, slow in zip(found[torch.float32], found[torch.float64], strict=True):
        assert fast.shape == slow.shape
        largest = max(1.0, float(slow.detach().abs().max())) if slow.numel() else 0.0
        assert torch.allclose(fast.double(), slow, rtol=0.0, atol=2e-6 * largest)


def table(deformation: BilinearDeformation, gaussians: Gaussians, p: float) -> torch.Tensor:
    return flat(deformation.offsets(gaussians, torch.tensor([p])))


def test_an_attribute_that_is_held_still_leaves_the_others_and_takes_no_space() -> None:
    gaussians = canonical(9, 12)
    whole = random_deformation(gaussians, 1, torch.float32)
    without = whole.without("quats").without("colors")
    expected = table(whole, gaussians, 0.3).clone()
    expected[:, 6:10] = 0.0
    expected[:, 11:] = 0.0
    assert torch.equal(table(without, gaussians, 0.3), expected)
    assert [without.moves(name) for name in gaussians.tensors()] == [True, True, False, True, False]
    assert without.stored()["weights_out"].shape == (5 * 7, 7)
    loaded = load_deformation(without.stored(), without.record())
    assert torch.equal(table(loaded, gaussians, 0.3), expected)  # type: ignore[arg-type]
    deformed = without.deformed(gaussians, torch.tensor([0.3]))
    assert torch.equal(deformed.quats, gaussians.quats)


def test_nothing_moves_where_every_attribute_is_held_still() -> None:
    gaussians = canonical(4, 3)
    still = random_deformation(gaussians, 1, torch.float32)
    for name in gaussians.tensors():
        still = still.without(name)
    loaded = load_deformation(still.stored(), still.record())
    assert not table(loaded, gaussians, 0.7).any()  # type: ignore[arg-type]
    assert loaded.reduced(1, [torch.tensor([0.5])]).latent_size == 1


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_fewer_modes_change_offsets_as_little_as_any_of_that_rank_can(size: int) -> None:
    gaussians = canonical(40, 3)
    deformation = random_deformation(gaussians, 1, torch.float32)
    places = [torch.tensor([p]) for p in (-1.0, -0.3, 0.4, 1.0)]
    per_unit = torch.where(deformation.units > 0, 1.0 / deformation.units, 0.0)

    def all_offsets(d: BilinearDeformation) -> torch.Tensor:
        return torch.cat([flat(d.offsets(gaussians, p)) * per_unit for p in places], dim=1).double()  # [N, places C]

    whole, reduced = all_offsets(deformation), deformation.reduced(size, places)
    lost = torch.linalg.svdvals(whole)[size:].square().sum().sqrt()  # Eckart & Young
    assert reduced.latents.shape == (40, size)
    error = (all_offsets(reduced) - whole).norm()
    assert float(error) == pytest.approx(float(lost), rel=1e-3)
    assert deformation.reduced(5, places) is deformation


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_as_many_colour_columns_move_as_are_asked_for(dtype: torch.dtype) -> None:
    gaussians = canonical(7, 12, dtype)
    deformation = random_deformation(gaussians, 3, dtype, color_columns=12)
    place = torch.tensor([0.1, 0.8, 0.3], dtype=dtype)
    moved = deformation.deformed(gaussians, place)
    assert (moved.colors != gaussians.colors).all()
    expected = deformation.offsets(gaussians, place).applied_to(gaussians)
    torch.testing.assert_close(moved.colors, expected.colors, rtol=0, atol=1e-5)
    loaded = BilinearDeformation.load(deformation.stored(), deformation.record())
    assert loaded.units.shape == (23,)


@pytest.mark.parametrize(("size", "width"), [(16, 64), (8, 32), (64, 64), (16, 512), (64, 256)])
def test_the_first_steps_move_offsets_equally_far_whatever_the_widths(size: int, width: int) -> None:
    """The function that is learnt moves by about the same, though it is a sum over more modes and hidden units."""
    settings = TrainingSettings(latent_size=size, hidden_width=width)
    gaussians = Gaussians(
        torch.zeros(50, 3), torch.zeros(50, 3), torch.ones(50, 4), torch.zeros(50), torch.zeros(50, 3)
    )
    deformation = BilinearDeformation.create(gaussians, 2, settings)
    tensors = {name: tensor.requires_grad_() for name, tensor in deformation.tensors().items()}
    adam = Adam(tensors, deformation.rates(settings), shared=set(tensors) - deformation.per_gaussian)
    for _ in range(5):
        moved = deformation.deformed(gaussians, torch.tensor([0.5, -0.3]))
        moved.log_scales.sum().backward()
        adam.step(1.0)
    moved = deformation.deformed(gaussians, torch.tensor([0.5, -0.3]))
    assert 0.2 < float(moved.log_scales.detach().abs().max()) < 1.8


def test_more_modes_move_nothing_yet_but_can_learn() -> None:
    gaussians = canonical(11, 3)
    narrow = random_deformation(gaussians, 2, torch.float32)
    wide = narrow.widened(9, seed=0)
    place = torch.tensor([0.2, -0.4])
    assert (narrow.latent_size, wide.latent_size, narrow.widened(5, seed=0)) == (5, 9, narrow)
    torch.testing.assert_close(flat(wide.offsets(gaussians, place)), flat(narrow.offsets(gaussians, place)))
    learning = wide.copy()
    learning.weights_out.requires_grad_()
    flat(learning.offsets(gaussians, place)).sum().backward()
    assert learning.weights_out.grad is not None
    assert learning.weights_out.grad[5 * 14 :].abs().max() > 0
    assert torch.equal(BilinearDeformation.load(wide.stored(), wide.record()).latents, wide.latents)
