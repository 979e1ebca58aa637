"""Blended values against the dense float64 sum over all Gaussians, forward and backward, and the loss on them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from surrogate.appearance.field_gaussians import FieldGaussians, FieldValues
from surrogate.appearance.scale import ValueScale
from surrogate.initialization.field_points import FieldPoints
from surrogate.training.value_loss import (
    BEYOND,
    NAMES,
    KnownValues,
    blended_values,
    blended_values_reference,
    value_loss,
)
from tests.support.field_blobs import FUNCTION

Carriers = dict[str, Tensor]


def carriers(count: int, scale: float = 0.15, *, seed: int = 0) -> Carriers:
    """Gaussians in [-1, 1]^3, float64, whose numbers float32 holds."""
    random = np.random.default_rng(seed)
    made = {
        "means": random.uniform(-1.0, 1.0, (count, 3)),
        "scales": scale * np.exp(random.uniform(-0.7, 0.7, (count, 3))),
        "quats": random.normal(size=(count, 4)),
        "weights": random.random(count),
        "values": random.random(count),
    }
    return {name: torch.from_numpy(made[name].astype(np.float32)).double() for name in NAMES}


def places_of(count: int, seed: int = 1, size: float = 1.0) -> Tensor:
    random = np.random.default_rng(seed)
    return torch.from_numpy(random.uniform(-size, size, (count, 3)).astype(np.float32)).double()


def needles() -> Carriers:
    made = carriers(400)
    made["scales"][:, 0] *= 5.0
    made["scales"][:, 1:] *= torch.tensor(0.0625)
    return made


def blended(given: Carriers, places: Tensor, reach: float = 3.0) -> tuple[Tensor, list[Tensor]]:
    """The values, and the derivatives of the sum of those times 1, 2, 3, ... by all tensors."""
    tensors = [tensor.clone().requires_grad_() for tensor in given.values()]
    found = blended_values(*tensors, places, reach=reach)
    upstream = torch.arange(1, len(places) + 1) / len(places)
    (found.nan_to_num(0.0) * upstream.to(found)).sum().backward()
    return found.detach(), [torch.zeros_like(t) if t.grad is None else t.grad for t in tensors]


def clear_of_the_edge(given: Carriers, places: Tensor, reach: float = 3.0) -> Tensor:
    """The places for which rounding can't decide whether a Gaussian reaches them."""
    axes = Rotation.from_quat(given["quats"].numpy()[:, [1, 2, 3, 0]]).as_matrix() / given["scales"].numpy()[:, None, :]
    offsets = places.numpy()[:, None] - given["means"].numpy()  # [Q, N, 3]
    distances = np.sqrt((np.einsum("qnc,nck->qnk", offsets, axes) ** 2).sum(2))  # [Q, N]
    return places[torch.from_numpy((np.abs(distances - reach) > 1e-4).all(1))]


HOSTILE: dict[str, Callable[[], tuple[Carriers, Tensor]]] = {
    "ordinary": lambda: (carriers(300), places_of(200)),
    "one place": lambda: (carriers(500), places_of(1)),
    "two Gaussians": lambda: (carriers(2, 0.6), places_of(40)),
    "needles": lambda: (needles(), places_of(200)),
    "huge Gaussians": lambda: (carriers(60, 30.0), places_of(50)),
    "tiny Gaussians": lambda: (carriers(400, 1e-3), carriers(400)["means"][:50] + 1e-3 * places_of(50)),
    "places at means": lambda: (carriers(200), carriers(200)["means"][:64]),
    "places far apart": lambda: (carriers(200), torch.cat([places_of(20), places_of(20, size=1e6)])),
    "the same place again and again": lambda: (carriers(200), places_of(1).repeat(70, 1)),
    "places in a plane": lambda: (carriers(200), places_of(70) * torch.tensor([1.0, 0.0, 1.0])),
    "weights of every size": lambda: (
        carriers(300) | {"weights": 10.0 ** torch.from_numpy(np.random.default_rng(6).integers(-30, 5, 300)).double()},
        places_of(100),
    ),
    "some weights are zero": lambda: (
        carriers(300) | {"weights": (carriers(300)["weights"] - 0.5).clamp(min=0)},
        places_of(99),
    ),
    "large values": lambda: (carriers(300) | {"values": 1e6 * carriers(300)["values"] - 3e5}, places_of(99)),
    "long quaternions": lambda: (carriers(300) | {"quats": 1000.0 * carriers(300)["quats"]}, places_of(99)),
    "far from the origin": lambda: (
        carriers(300) | {"means": carriers(300)["means"] + 64.0},
        places_of(99).float().double() + 64.0,
    ),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_the_kernel_is_the_dense_sum_forward_and_backward(case: str) -> None:
    given, places = HOSTILE[case]()
    given = {name: tensor.float().double() for name, tensor in given.items()}
    places = clear_of_the_edge(given, places.float().double())
    assert len(places)
    slow, slow_gradients = blended(given, places)
    fast, fast_gradients = blended({name: tensor.float() for name, tensor in given.items()}, places.float())
    assert torch.equal(fast.isnan(), slow.isnan())
    size = float(given["values"].abs().max())
    torch.testing.assert_close(fast.double(), slow, rtol=2e-5, atol=2e-6 * size, equal_nan=True)
    for name, quick, exact in zip(NAMES, fast_gradients, slow_gradients, strict=True):
        bound = 2e-4 * float(exact.abs().max()) + 1e-9
        assert float((quick.double() - exact).abs().max()) <= bound, name


def test_the_dense_sum_is_what_scipy_and_finite_differences_say() -> None:
    given, places = carriers(20, 0.4), places_of(12)
    covariances = [
        r @ np.diag(s**2) @ r.T
        for r, s in zip(
            Rotation.from_quat(given["quats"].numpy()[:, [1, 2, 3, 0]]).as_matrix(),
            given["scales"].numpy(),
            strict=True,
        )
    ]
    offsets = places.numpy()[:, None] - given["means"].numpy()  # [Q, N, 3]
    squared = np.stack(
        [
            np.einsum("qc,cd,qd->q", d, np.linalg.inv(c), d)
            for d, c in zip(offsets.swapaxes(0, 1), covariances, strict=True)
        ],
        1,
    )
    density = given["weights"].numpy() * np.exp(-0.5 * squared) * (squared <= 16.0)
    wanted = density @ given["values"].numpy() / density.sum(1)
    found = blended_values_reference(*given.values(), places, reach=4.0)
    np.testing.assert_allclose(found.numpy(), wanted, rtol=1e-12)
    tensors = [tensor.clone().requires_grad_() for tensor in given.values()]
    assert torch.autograd.gradcheck(lambda *t: blended_values_reference(*t, places, reach=30.0), tensors)


def test_three_standard_deviations_are_nearly_the_whole_sum() -> None:
    given, places = carriers(2000, 0.1), places_of(200, size=0.7)
    given["values"] = torch.sin(2.0 * given["means"]).sum(1)  # a field, as training has it
    near, whole = (blended_values(*given.values(), places, reach=reach) for reach in (3.0, 12.0))
    assert float(whole.max() - whole.min()) > 4.0
    assert float((near - whole).abs().max()) < 0.04
    assert float((near - whole).abs().mean()) < 0.01


def test_a_constant_is_blended_to_itself_and_a_place_without_gaussian_to_nothing() -> None:
    given = carriers(300) | {"values": torch.full((300,), 0.7).double()}
    places = torch.cat([places_of(30), torch.full((2, 3), 9.0).double()])
    found = blended_values(*(tensor.float() for tensor in given.values()), places.float())
    assert found[30:].isnan().all()
    np.testing.assert_allclose(found[:30], 0.7, atol=1e-6)


@pytest.mark.parametrize(("gaussians", "places"), [(0, 5), (5, 0), (0, 0)])
def test_nothing_is_no_error(gaussians: int, places: int) -> None:
    given = [tensor.float().requires_grad_() for tensor in carriers(gaussians).values()]
    found = blended_values(*given, places_of(places).float())
    assert found.shape == (places,)
    loss = value_loss(found, torch.zeros(places))
    loss.backward()
    assert loss.item() == 0.0 or gaussians


def test_only_what_is_asked_for_has_a_gradient_and_no_weights_are_equal_ones() -> None:
    given = [tensor.float() for tensor in carriers(300).values()]
    values = given[4].requires_grad_()
    places = places_of(50).float()
    found = blended_values(*given[:3], None, values, places)
    found.nan_to_num(0.0).sum().backward()
    assert values.grad is not None
    torch.testing.assert_close(found, blended_values(*given[:3], torch.full((300,), 2.5), values, places))
    assert all(tensor.grad is None for tensor in given[:4])


def test_the_loss_leaves_out_what_no_gaussian_covers() -> None:
    given = torch.tensor([0.5, torch.nan, 0.25, torch.nan], requires_grad=True)
    loss = value_loss(given, torch.tensor([0.25, 7.0, 1.0, torch.nan]))
    loss.backward()
    assert loss.item() == pytest.approx(0.5)
    assert given.grad is not None
    assert given.grad.tolist() == [0.5, 0.0, -0.5, 0.0]
    assert value_loss(torch.full((3,), torch.nan), torch.zeros(3)).item() == 0.0


def test_values_alone_are_learnt_from_points() -> None:
    """Of what no picture shows, by a step every 256 points."""
    given = [tensor.float() for tensor in carriers(1500, 0.12).values()]
    values = torch.full((1500,), 0.5, requires_grad=True)

    def field(places: Tensor) -> Tensor:
        return 0.5 + 0.25 * torch.sin(3.0 * places[:, 0]) + 0.2 * torch.cos(4.0 * places[:, 1] * places[:, 2])

    for step in range(40):
        places = places_of(256, seed=10 + step).float()
        loss = value_loss(blended_values(*given[:3], None, values, places), field(places))
        (slope,) = torch.autograd.grad(loss, values)
        values = (values - 20.0 * slope).detach().requires_grad_()
    unseen = places_of(500, seed=5, size=0.9).float()
    error = value_loss(blended_values(*given[:3], None, values.detach(), unseen), field(unseen))
    assert float(error) < 0.25 * float((field(unseen) - field(unseen).mean()).abs().mean())


def field_gaussians(count: int = 40) -> FieldGaussians:
    made = {name: tensor.float() for name, tensor in carriers(count).items()}
    values = torch.stack([made["values"], torch.full((count,), -3.0)], dim=1)  # [N, 2]
    logits = torch.linspace(-3.0, 3.0, count)
    field = FieldValues(FUNCTION, ValueScale.of_function(FUNCTION))
    return FieldGaussians(made["means"], made["scales"].log(), made["quats"], logits, values, field)


def known(value: float = 1.5) -> KnownValues:
    """Two members with points all over the box; the field is 0.5 in the first, and `value` in the second."""
    places = np.random.default_rng(3).uniform(-0.5, 0.5, (20, 3)).astype(np.float32)
    members = np.repeat([0, 1], 10)
    points = FieldPoints(
        ("a", "b"), np.zeros((2, 1), np.float32), places, np.array([0.5, value])[members], members, members > 5
    )
    return KnownValues(points, ValueScale.of_function(FUNCTION), seed=1)


def test_a_member_is_held_to_its_own_values_where_it_has_points() -> None:
    given, truth = field_gaussians(), known()
    for member, value in (("a", 0.5), ("b", 1.5)):
        rows = truth.points.members == truth.points.names.index(member)
        depths = given.opacity_logits.double().exp().log1p()  # [N]
        tensors = [given.means, given.log_scales.exp(), given.quats, depths, given.values[:, 0]]
        blended = blended_values_reference(
            *(tensor.double() for tensor in tensors), torch.from_numpy(truth.points.places[rows]).double()
        )
        differences = (blended - float(truth.scale.places(value))).abs()
        assert differences.min() <= float(truth.loss(given, member, 7)) <= differences.max()
        mean = np.mean([float(truth.loss(given, member, step)) for step in range(30)])
        assert mean == pytest.approx(float(differences.mean()), rel=0.02)


def test_all_that_says_where_values_lie_follows_them() -> None:
    given = field_gaussians()
    tensors = [tensor.requires_grad_() for tensor in given.tensors().values()]
    known().loss(given, "b", 0).backward()
    assert all(tensor.grad is not None and tensor.grad.abs().max() > 0 for tensor in tensors)


def test_what_lies_far_beyond_the_scale_pulls_no_harder_than_its_margin() -> None:
    given, far = field_gaussians(), known(1e30)
    assert float(far.loss(given, "b", 0)) <= 1.0 + BEYOND


def test_other_points_are_looked_at_in_every_step_and_the_same_when_resumed() -> None:
    given, truth = field_gaussians(), known()
    first = [float(truth.loss(given, "a", step)) for step in range(4)]
    assert len(set(first)) == 4
    assert [float(known().loss(given, "a", step)) for step in range(4)] == first


def test_a_member_without_points_has_no_say() -> None:
    loss = known().loss(field_gaussians(), "unknown", 0)
    assert loss.item() == 0.0


def test_twice_is_refused() -> None:
    given = [tensor.float().requires_grad_() for tensor in carriers(20).values()]
    found = blended_values(*given, places_of(5).float())
    with pytest.raises(RuntimeError, match="once only"):
        torch.autograd.grad(found.nan_to_num(0.0).sum(), given, create_graph=True, allow_unused=True)


@pytest.mark.parametrize(
    ("name", "number", "message"),
    [
        ("means", torch.nan, "means of Gaussian 3 is"),
        ("scales", torch.inf, "scales of Gaussian 3 is"),
        ("weights", -0.5, "weights of Gaussian 3 is -0.5.*must not be negative"),
        ("values", torch.nan, "values of Gaussian 3 is"),
    ],
)
def test_bad_numbers_are_named(name: str, number: float, message: str) -> None:
    given = {key: tensor.float() for key, tensor in carriers(10).items()}
    given[name][3] = number
    with pytest.raises(ValueError, match=message):
        blended_values(*given.values(), places_of(5).float())


def test_a_bad_place_is_named() -> None:
    places = places_of(5).float()
    places[2, 1] = torch.nan
    with pytest.raises(ValueError, match="coordinates of place 2 is"):
        blended_values(*(tensor.float() for tensor in carriers(10).values()), places)
