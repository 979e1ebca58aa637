import pytest
import torch

from surrogate.deformation import BilinearDeformation, Offsets, load_deformation
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings


def canonical(count: int, color_columns: int, dtype: torch.dtype = torch.float32) -> Gaussians:
    generator = torch.Generator().manual_seed(1)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, color_columns))
    return Gaussians(*(torch.randn(shape, generator=generator, dtype=dtype) for shape in shapes))


def random_deformation(gaussians: Gaussians, parameters: int, dtype: torch.dtype) -> BilinearDeformation:
    settings = TrainingSettings(latent_size=5, hidden_width=7)
    made = BilinearDeformation.create(gaussians, parameters, settings)
    generator = torch.Generator().manual_seed(2)
    tensors = {n: torch.randn(t.shape, generator=generator, dtype=dtype) for n, t in made.tensors().items()}
    return BilinearDeformation(**tensors, units=made.units.to(dtype))


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
    settings, latent, columns = TrainingSettings(), 5, 14
    units = [settings.mean_offset, settings.log_scale_offset, settings.quat_offset, settings.opacity_offset]
    column_units = [units[0]] * 3 + [units[1]] * 3 + [units[2]] * 4 + [units[3]] + [settings.color_offset] * 3
    for i in range(6):
        for c in range(columns):
            expected = 0.0
            for mode in range(latent):
                row = mode * columns + c
                hidden = deformation.weights_in @ p + deformation.biases_in
                hidden = hidden / (1.0 + torch.exp(-hidden))
                value = float(deformation.weights_out[row] @ hidden + deformation.biases_out[row])
                expected += float(deformation.latents[i, mode]) * value
            assert float(offsets[i, c]) == pytest.approx(expected * column_units[c], rel=1e-6)


def test_gradients_agree_with_finite_differences() -> None:
    gaussians = canonical(4, 3, torch.float64)
    deformation = random_deformation(gaussians, 3, torch.float64)
    names = list(deformation.tensors())

    def offsets(parameters: torch.Tensor, *tensors: torch.Tensor) -> torch.Tensor:
        moved = BilinearDeformation(**dict(zip(names, tensors, strict=True)), units=deformation.units)
        return flat(moved.offsets(gaussians, parameters))

    inputs = [torch.tensor([0.1, -0.5, 0.9], dtype=torch.float64), *deformation.tensors().values()]
    assert torch.autograd.gradcheck(offsets, [tensor.requires_grad_() for tensor in inputs])


def test_it_survives_being_saved() -> None:
    gaussians = canonical(5, 12)
    deformation = random_deformation(gaussians, 2, torch.float32)
    loaded = load_deformation(deformation.kind, deformation.tensors(), deformation.record())
    p = torch.tensor([0.2, 0.4])
    torch.testing.assert_close(
        flat(loaded.offsets(gaussians, p)), flat(deformation.offsets(gaussians, p)), rtol=0, atol=0
    )


def test_an_unknown_kind_is_named() -> None:
    with pytest.raises(ValueError, match="unknown deformation 'warp'"):
        load_deformation("warp", {}, {})


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
    loaded = load_deformation(without.kind, without.stored(), without.record())
    assert torch.equal(table(loaded, gaussians, 0.3), expected)  # type: ignore[arg-type]
    deformed = without.deformed(gaussians, torch.tensor([0.3]))
    assert torch.equal(deformed.quats, gaussians.quats)


def test_nothing_moves_where_every_attribute_is_held_still() -> None:
    gaussians = canonical(4, 3)
    still = random_deformation(gaussians, 1, torch.float32)
    for name in gaussians.tensors():
        still = still.without(name)
    loaded = load_deformation(still.kind, still.stored(), still.record())
    assert not table(loaded, gaussians, 0.7).any()  # type: ignore[arg-type]
    assert loaded.reduced(1, [torch.tensor([0.5])]).latent_size == 1


def test_models_whose_deformation_moved_all_colour_columns_still_work() -> None:
    gaussians = canonical(8, 12)
    made = random_deformation(gaussians, 1, torch.float32)
    older = BilinearDeformation(
        made.latents, made.weights_in, made.biases_in, torch.randn(5 * 23, 7), torch.randn(5 * 23), torch.ones(23)
    )
    p = torch.tensor([0.4])
    slow = older.offsets(gaussians, p).applied_to(gaussians)
    fast = older.deformed(gaussians, p)
    for a, b in zip(fast.tensors().values(), slow.tensors().values(), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=1e-5)


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
