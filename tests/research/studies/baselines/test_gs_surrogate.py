from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from research.studies.baselines import canonical, gs_surrogate
from research.studies.baselines.canonical import HarmonicGaussians
from research.studies.baselines.gs_surrogate import METHOD, GSSurrogate, GSSurrogateArchitecture, HardMining, Recipe
from research.studies.baselines.method import Plan, TrainingImages
from surrogate.training.losses import structural_similarity
from tests.research.support.baseline_scenes import ball_pictures, psnr_of_mean, psnr_over

NARROW = (16, 32)  # widths of the features and of the hidden layers


def begun(pictures: TrainingImages, plan: Plan, recipe: Recipe | None = None, gaussians: int = 60) -> GSSurrogate:
    """A training of a narrow network from Gaussians that have not learnt anything."""
    start = canonical.initial(pictures, 0, gaussians).tensors()
    return GSSurrogate(pictures, plan, start, GSSurrogateArchitecture(pictures.parameters.shape[1], *NARROW), recipe)


def copied(fit: GSSurrogate) -> dict[str, Tensor]:
    return {name: tensor.detach().clone() for name, tensor in fit.tensors().items()}


@pytest.mark.parametrize("parameters", [0, 1, 3, 6])
def test_the_official_network_has_as_many_numbers_as_the_authors_code(parameters: int) -> None:
    def layer(columns: int, rows: int, normalized: bool = True) -> int:
        return columns * rows + rows + 2 * rows * normalized

    position = layer(3 + 3 * 2 * 10, 512) + layer(512, 512) + layer(512, 128, normalized=False)
    condition = layer(parameters + parameters * 2 * 2, 512) + layer(512, 128, normalized=False)
    adapter = layer(128, 128) + layer(128, 128, normalized=False)
    backbone = layer(128, 512) + 2 * layer(512, 512)
    heads = sum(layer(512, 512) + layer(512, columns, normalized=False) for columns in (3, 3, 4, 1, 48))
    expected = position + condition + adapter + backbone + heads
    assert expected == 2_406_715 + 2_560 * parameters  # of their modules, which were run
    found = GSSurrogateArchitecture(parameters).initial(np.random.default_rng(0))
    assert sum(tensor.numel() for tensor in found.values()) == expected


def test_layers_start_as_those_of_torch_and_last_ones_of_adapter_and_heads_at_zero() -> None:
    found = GSSurrogateArchitecture(2).initial(np.random.default_rng(0))
    for name, tensor in found.items():
        network, layer, part = name.split(".")
        still = layer == "1" and network not in ("position", "parameters", "backbone")
        if part in ("weights", "biases") and not still:
            bound = 1.0 / math.sqrt(found[f"{network}.{layer}.weights"].shape[1])
            assert bound * 0.9 < float(tensor.abs().max()) <= bound
            assert abs(float(tensor.mean())) < 0.25 * bound
        else:
            assert torch.equal(tensor, torch.full_like(tensor, float(part == "gains")))


def modules_of(networks: Mapping[str, Tensor], name: str) -> nn.Sequential:
    """The layers of a perceptron as torch's modules."""
    layers: list[nn.Module] = []
    for number in range(3):
        prefix = f"{name}.{number}"
        if f"{prefix}.weights" in networks:
            rows, columns = networks[f"{prefix}.weights"].shape
            layers.append(nn.Linear(columns, rows))
            layers[-1].load_state_dict({"weight": networks[f"{prefix}.weights"], "bias": networks[f"{prefix}.biases"]})
        if f"{prefix}.gains" in networks:
            layers += [nn.LayerNorm(len(networks[f"{prefix}.gains"])), nn.ReLU()]
            layers[-2].load_state_dict({"weight": networks[f"{prefix}.gains"], "bias": networks[f"{prefix}.shifts"]})
    return nn.Sequential(*layers)


def encoded(values: Tensor, frequencies: int) -> Tensor:
    angles = [math.pi * 2.0**k * values[:, [d]].double() for d in range(values.shape[1]) for k in range(frequencies)]
    return torch.cat([values, *(a.sin() for a in angles), *(a.cos() for a in angles)], dim=1).float()


NETWORKS = ("position", "parameters", "adapter", "backbone", *gs_surrogate.COLUMNS)


def published(parts: Mapping[str, nn.Sequential], places: Tensor, parameters: Tensor) -> dict[str, Tensor]:
    """The offsets once more, by torch's modules."""
    condition = encoded(((parameters + 1.0) / 2.0).expand(len(places), -1), 2)
    shift = parts["adapter"](parts["parameters"](condition))
    features = parts["backbone"](parts["position"](encoded(places, 10)) + shift)
    found = {name: parts[name](features) for name in gs_surrogate.COLUMNS}
    return found | {"opacity_logits": torch.tanh(found["opacity_logits"])}


@torch.no_grad()
def test_offsets_are_those_of_the_published_network() -> None:
    random = np.random.default_rng(3)
    architecture = GSSurrogateArchitecture(2, *NARROW)
    drawn = {name: random.normal(0.0, 0.3, t.shape) for name, t in architecture.initial(random).items()}
    networks = {name: torch.from_numpy(values).to(torch.float32) for name, values in drawn.items()}
    places, parameters = torch.from_numpy(random.uniform(-0.2, 0.2, (7, 3))).float(), torch.tensor([-0.5, 0.8])
    found = gs_surrogate.offsets(networks, architecture, places, parameters)
    parts = {name: modules_of(networks, name) for name in NETWORKS}
    for name, expected in published(parts, places, parameters).items():
        torch.testing.assert_close(found[name], expected, rtol=1e-4, atol=1e-4)


def test_steps_are_those_of_the_authors_training_in_coordinates_of_the_cameras() -> None:
    """Their world has the mean of the cameras in its middle and the farthest of them at 1; means learn faster here, to be seen."""
    pictures, steps = ball_pictures([[-1.0], [0.3]], views=6, background=(1.0, 1.0, 1.0)), 4
    fit = begun(pictures, Plan(steps), Recipe(mean_factor=10.0))
    positions = np.array([camera.position for camera in pictures.cameras])
    middle = torch.from_numpy(positions.mean(axis=0)).float()
    unit = float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).max())
    start = {name: tensor.detach().clone() for name, tensor in fit.tensors().items()}
    networks = {name.removeprefix("network."): tensor for name, tensor in start.items()}
    parts = {name: modules_of(networks, name) for name in NETWORKS}
    own = {"means": (start["means"] - middle) / unit, "log_scales": start["log_scales"] - math.log(unit)}
    own |= {"quats": start["quats"], "opacity_logits": start["opacity_logits"]}
    own |= {"base": start["harmonics"][:, :1], "rest": start["harmonics"][:, 1:]}
    leaves = {name: nn.Parameter(tensor.clone()) for name, tensor in own.items()}
    rates = {
        "means": 1.6e-3,
        "log_scales": 5e-3,
        "quats": 1e-3,
        "opacity_logits": 5e-2,
        "base": 2.5e-3,
        "rest": 1.25e-4,
    }
    adams = {name: torch.optim.Adam([leaves[name]], lr=rate, eps=1e-15) for name, rate in rates.items()}
    adams["network"] = torch.optim.Adam([t for part in parts.values() for t in part.parameters()], lr=1e-4)
    gamma = 0.1 ** (1.0 / steps)
    falling = [torch.optim.lr_scheduler.ExponentialLR(adams[name], gamma) for name in ("means", "network")]
    mining = HardMining(len(pictures), Plan(steps), 1.5)
    for step in range(steps):
        picture = mining.drawn(step)
        offsets = published(parts, leaves["means"].detach() / 1.1, pictures.parameters[picture])
        moved = HarmonicGaussians(
            middle + unit * (leaves["means"] + offsets["means"]),
            leaves["log_scales"] + offsets["log_scales"] + math.log(unit),
            torch.nn.functional.normalize(leaves["quats"] + offsets["quats"], dim=1),
            leaves["opacity_logits"] + offsets["opacity_logits"][:, 0],
            torch.cat([leaves["base"], leaves["rest"]], dim=1) + offsets["harmonics"].reshape(-1, 16, 3),
        )
        drawn, true = moved.draw_over(pictures.camera(picture), pictures.behind)[..., :3], pictures.over([picture])[0]
        loss = 0.8 * (drawn - true).abs().mean() + 0.2 * (1.0 - structural_similarity(drawn, true).mean())
        for adam in adams.values():
            adam.zero_grad()
        loss.backward()
        for adam in adams.values():
            adam.step()
        for schedule in falling:
            schedule.step()
        mining.tell(step, picture, loss.item())
        assert fit.advance() == pytest.approx(loss.item(), rel=1e-4)
    found = fit.tensors()
    torch.testing.assert_close(found["means"].detach(), middle + unit * leaves["means"].detach(), rtol=0.0, atol=1e-4)
    torch.testing.assert_close(found["opacity_logits"].detach(), leaves["opacity_logits"].detach(), rtol=0.0, atol=1e-4)
    assert float((found["means"] - start["means"]).detach().abs().max()) > 5e-3
    for name in ("backbone.1", "harmonics.1"):
        weights = list(parts[name.split(".")[0]].parameters())[4].detach()  # after those of one layer and its LayerNorm
        torch.testing.assert_close(found[f"network.{name}.weights"].detach(), weights, rtol=0.0, atol=1e-5)
        assert float((weights - start[f"network.{name}.weights"]).abs().max()) > 5e-5


@pytest.mark.parametrize("background", [None, (0.2, 0.4, 0.1)])
@pytest.mark.parametrize("parameters", [0, 1, 3, 6])
def test_nothing_moves_at_first(parameters: int, background: tuple[float, float, float] | None) -> None:
    pictures = ball_pictures(np.linspace(-1.0, 1.0, 2 * parameters).reshape(2, parameters), 2, 16, background)
    fit = begun(pictures, Plan(3))
    still = canonical.initial(pictures, 0, 60).picture(pictures.cameras[1], background)
    for value in (-1.0, 0.3):
        picture = fit.at(torch.full((parameters,), value))(pictures.cameras[1])
        assert picture.shape == (16, 16, 4)
        assert picture.dtype == np.float32
        np.testing.assert_array_equal(picture, still)
    losses = [fit.advance() for _ in range(3)]
    assert np.isfinite(losses).all()
    after = fit.at(torch.zeros(parameters))(pictures.cameras[1])
    assert np.abs(after - still).max() > 1e-3
    assert np.isfinite(after).all()
    assert after.min() >= 0.0
    assert (after[..., :3] <= after[..., 3:] + 1e-6).all()
    if background is not None:
        assert (after[..., 3] == 1.0).all()


def test_offsets_are_raw_but_means_move_in_units_of_the_cameras_distance() -> None:
    pictures = ball_pictures([[0.0], [1.0]], views=6)
    fit = begun(pictures, Plan(1))
    outputs = {"means": [0.01, -0.02, 0.03], "log_scales": [0.1, 0.2, -0.1], "quats": [0.2, 0.1, 0.0, -0.3]}
    outputs |= {"opacity_logits": [2.0], "harmonics": list(np.linspace(-0.2, 0.2, 48))}
    with torch.no_grad():
        for name, values in outputs.items():
            fit.tensors()[f"network.{name}.1.biases"].copy_(torch.tensor(values))
    positions = np.array([camera.position for camera in pictures.cameras])
    distance = np.linalg.norm(positions - positions.mean(axis=0), axis=1).max()
    start = canonical.initial(pictures, 0, 60)
    moved = HarmonicGaussians(
        start.means + distance * torch.tensor(outputs["means"]),
        start.log_scales + torch.tensor(outputs["log_scales"]),
        start.quats + torch.tensor(outputs["quats"]),
        start.opacity_logits + math.tanh(2.0),
        start.harmonics + torch.linspace(-0.2, 0.2, 48).reshape(16, 3),
    )
    for camera in pictures.cameras:
        expected = moved.picture(camera, None)
        np.testing.assert_allclose(fit.at(torch.zeros(1))(camera), expected, atol=1e-3)
        assert np.abs(expected - start.picture(camera, None)).max() > 0.1


def test_gradients_reach_every_network_after_two_steps() -> None:
    """Zeros of the heads' last layers stop them in the first step, and zeros of the adapter's last layer in the second."""
    fit = begun(ball_pictures([[-1.0], [1.0]]), Plan(10))
    before = copied(fit)
    for reached in (
        ["means", "quats", "harmonics"],
        ["backbone", "position", "adapter.1"],
        ["adapter.0", "parameters"],
    ):
        networks = tuple(f"network.{name}" for name in reached)
        assert all(torch.equal(before[name], t) for name, t in copied(fit).items() if name.startswith(networks))
        fit.advance()
        after = copied(fit)
        assert all(any(not torch.equal(before[n], after[n]) for n in before if n.startswith(net)) for net in networks)
    assert [name for name in before if torch.equal(before[name], copied(fit)[name])] == []


def test_means_are_nearly_still_and_the_other_canonical_tensors_learn_at_full_rates() -> None:
    pictures = ball_pictures([[-1.0], [1.0]], views=6)
    largest = {}
    for factor in (1.0, 0.001):
        fit = begun(pictures, Plan(3), Recipe(other_factor=factor))
        before = copied(fit)
        fit.advance()
        moves = {name: float((tensor - before[name]).abs().max()) for name, tensor in copied(fit).items()}
        largest[factor] = moves
        positions = np.array([camera.position for camera in pictures.cameras])
        distance = np.linalg.norm(positions - positions.mean(axis=0), axis=1).max()
        assert moves["means"] == pytest.approx(1.6e-4 * 0.001 * distance, rel=0.1)  # Adam's first step is the rate
    expected = {"log_scales": 5e-3, "opacity_logits": 5e-2, "harmonics": 2.5e-3}
    for name, rate in expected.items():
        assert largest[1.0][name] == pytest.approx(rate, rel=0.01)
        assert largest[0.001][name] == pytest.approx(0.001 * rate, rel=0.05)


@pytest.mark.parametrize("steps", [1, 2, 7, 80_000])
def test_rates_of_network_and_means_fall_to_a_tenth_over_any_plan(steps: int) -> None:
    recipe, plan = Recipe(), Plan(steps, rate=2.0)
    first, last = (gs_surrogate.rates(recipe, plan, 5.5, step) for step in (0, steps))
    assert first["network"] == pytest.approx(2e-4)
    assert first["means"] == pytest.approx(2.0 * 1.6e-4 * 0.001 * 5.0)
    assert first["opacity_logits"] == pytest.approx(0.1)
    for name, rate in first.items():
        assert last[name] == pytest.approx(rate * (0.1 if name in ("network", "means") else 1.0))
    fit = begun(ball_pictures([[0.0]], views=1), Plan(min(steps, 7)))
    for _ in range(min(steps, 7)):
        assert math.isfinite(fit.advance())


def test_loss_is_a_fifth_structural_similarity() -> None:
    random = torch.Generator().manual_seed(0)
    drawn, picture = torch.rand(16, 20, 4, generator=random), torch.rand(16, 20, 3, generator=random)
    similarity = structural_similarity(drawn[..., :3].double(), picture.double()).mean()
    expected = 0.8 * (drawn[..., :3] - picture).abs().double().mean() + 0.2 * (1.0 - similarity)
    assert float(Recipe().loss(drawn, picture)) == pytest.approx(float(expected), abs=1e-5)


def test_training_draws_the_worst_picture_most_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture that nothing can be learnt of, random noise, among flat white ones."""
    pictures = ball_pictures([[0.0]], views=6)
    pixels = np.zeros_like(pictures.pixels)
    pixels[4] = 255 * np.random.default_rng(0).integers(0, 2, (16, 16, 1))
    fit = begun(replace(pictures, pixels=pixels), Plan(120))
    drawn: list[int] = []
    compared = canonical.compared

    def noted(of: TrainingImages, picture: int) -> Tensor:
        drawn.append(picture)
        return compared(of, picture)

    monkeypatch.setattr(canonical, "compared", noted)
    for _ in range(120):
        fit.advance()
    assert drawn.count(4) > 60


def test_pictures_of_the_same_parameters_cost_one_evaluation(monkeypatch: pytest.MonkeyPatch) -> None:
    evaluated: list[Tensor] = []
    offsets = gs_surrogate.offsets

    def counted(
        networks: Mapping[str, Tensor], architecture: GSSurrogateArchitecture, places: Tensor, at: Tensor
    ) -> object:
        evaluated.append(at)
        return offsets(networks, architecture, places, at)

    monkeypatch.setattr(gs_surrogate, "offsets", counted)
    pictures = ball_pictures([[-1.0], [1.0]], views=3)
    fit = begun(pictures, Plan(5))
    parameters = torch.tensor([0.5])
    shown = [render(camera) for render in [fit.at(parameters)] for camera in pictures.cameras]
    assert len(evaluated) == 1
    assert not np.array_equal(shown[0], shown[1])
    fit.at(parameters + 0.1)
    assert len(evaluated) == 2
    fit.advance()
    assert not np.array_equal(fit.at(parameters)(pictures.cameras[0]), shown[0])


def test_one_seed_gives_the_same_numbers_and_another_others() -> None:
    pictures = ball_pictures([[-1.0], [1.0]])

    def trained(seed: int) -> tuple[list[float], np.ndarray]:
        fit = begun(pictures, Plan(6, seed=seed))
        return [fit.advance() for _ in range(6)], fit.at(torch.tensor([0.4]))(pictures.cameras[0])

    (first, picture), (again, same), (other, another) = trained(0), trained(0), trained(1)
    assert first == again
    np.testing.assert_array_equal(picture, same)
    assert first != other
    assert np.abs(picture - another).max() > 0.0
    fits = [begun(pictures, Plan(6, seed=seed)).tensors()["network.position.0.weights"] for seed in (0, 1)]
    assert not torch.equal(*fits)
    orders = [[HardMining(50, Plan(6, seed=seed), 1.5).drawn(step) for step in range(20)] for seed in (0, 1)]
    assert orders[0] != orders[1]


def test_what_was_prepared_is_left_alone_and_must_be_complete() -> None:
    pictures = ball_pictures([[-1.0], [1.0]])
    start = canonical.initial(pictures, 0, 40).tensors()
    kept = {name: tensor.clone() for name, tensor in start.items()}
    fit = GSSurrogate(pictures, Plan(2), start, GSSurrogateArchitecture(1, *NARROW))
    fit.advance()
    assert all(torch.equal(start[name], kept[name]) for name in kept)
    assert not torch.equal(fit.tensors()["harmonics"], kept["harmonics"])
    del start["quats"]
    with pytest.raises(KeyError, match="quats"):
        GSSurrogate(pictures, Plan(2), start, GSSurrogateArchitecture(1, *NARROW))


def test_both_sizes_of_the_method_are_the_published_one() -> None:
    pictures = ball_pictures([[-1.0, 0.0, 1.0]], views=1)
    start = canonical.initial(pictures, 0, 30).tensors()
    for size in ("official", "small"):
        fit = METHOD.begin(pictures, Plan(1, size=size), start)
        networks = [tensor for name, tensor in fit.tensors().items() if name.startswith("network.")]
        assert sum(tensor.numel() for tensor in networks) == 2_414_395
        assert all(torch.equal(fit.tensors()[name], tensor) for name, tensor in start.items())


def test_bfloat16_computes_nearly_the_same_offsets_and_gradients() -> None:
    """Sums of gradients over thousands of Gaussians, which bfloat16 could not hold, are exact."""
    random = np.random.default_rng(1)
    architecture = GSSurrogateArchitecture(1, *NARROW)
    networks = architecture.initial(random)
    for name, tensor in networks.items():
        still = not tensor.any() and name.endswith(("weights", "biases"))
        values = 0.1 * random.normal(size=tensor.shape) if still else tensor.numpy()
        networks[name] = torch.from_numpy(values).to(torch.float32).requires_grad_()
    places = torch.from_numpy(random.uniform(-0.2, 0.2, (6000, 3))).to(torch.float32)
    wanted = torch.sin(5.0 * places[:, :1]) + 2.0  # [N, 1]
    found, gradients = [], []
    for narrow in (False, True):
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=narrow):
            offsets = gs_surrogate.offsets(networks, architecture, places, torch.tensor([0.3]))
        loss = sum((((offset - wanted) ** 2).mean() for offset in offsets.values()), torch.zeros(()))
        found.append({name: offset.detach() for name, offset in offsets.items()})
        gradients.append(torch.autograd.grad(loss, list(networks.values())))
    for name, exact in found[0].items():
        assert found[1][name].dtype == torch.float32
        assert 0.0 < float((found[1][name] - exact).norm() / exact.norm()) < 0.02
    for name, exact, rough in zip(networks, *gradients, strict=True):
        assert float((rough - exact).norm() / exact.norm()) < 0.06, name


def test_plans_in_bfloat16_train() -> None:
    pictures = ball_pictures([[-1.0], [1.0]])
    losses = {}
    for precision in ("float32", "bfloat16"):
        fit = begun(pictures, Plan(20, precision=precision), Recipe(rate=1e-3))
        losses[precision] = [fit.advance() for _ in range(20)]
        assert all(tensor.dtype == torch.float32 for tensor in fit.tensors().values())
    assert losses["float32"] != losses["bfloat16"]
    np.testing.assert_allclose(losses["bfloat16"], losses["float32"], rtol=0.1)


def test_a_moving_ball_is_learnt_better_than_any_still_gaussians_can_show_it() -> None:
    pictures = ball_pictures([[-1.0], [0.0], [1.0]], views=3, size=12)
    start = canonical.prepare(pictures, 0, count=60, steps=100)
    plan = Plan(130)
    fit = GSSurrogate(pictures, plan, start, GSSurrogateArchitecture(1, 32, 64), Recipe(rate=1e-3))

    def mean_psnr() -> float:
        shown = [fit.at(pictures.parameters[i])(pictures.camera(i)) for i in range(len(pictures))]
        return float(np.mean([psnr_over(pictures, i, picture) for i, picture in enumerate(shown)]))

    still = mean_psnr()
    assert still > psnr_of_mean(pictures) + 2.0
    for _ in range(plan.steps):
        fit.advance()
    assert mean_psnr() > still + 5.0
