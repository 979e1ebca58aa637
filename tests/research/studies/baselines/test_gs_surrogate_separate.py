"""The separate networks of GS-Surrogate for isosurfaces and transfer functions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from research.studies.baselines import canonical, gs_surrogate, gs_surrogate_separate
from research.studies.baselines.gs_surrogate import GSSurrogate, GSSurrogateArchitecture, cosine_decay
from research.studies.baselines.gs_surrogate_separate import (
    FOR_FUNCTIONS,
    FOR_ISOSURFACES,
    ISOSURFACES,
    FunctionsOnVolume,
    base_of,
    images_of_functions,
    of_functions,
    of_isosurfaces,
)
from research.studies.baselines.method import Plan, TrainingImages
from tests.research.support.baseline_scenes import ball_pictures, psnr_over

NARROW = (8, 16)  # widths of the features and of the hidden layers
TWO_MEMBERS = [[-1.0, 0.0], [1.0, 0.0], [-1.0, -1.0], [1.0, 1.0]]  # the base, and a function for each


def varied(parameters: list[list[float]], views: int = 2) -> TrainingImages:
    """Images whose last parameter is the visualization's."""
    return replace(ball_pictures(parameters, views=views, size=12), visualization=1)


def begun(pictures: TrainingImages, plan: Plan) -> FunctionsOnVolume:
    start = canonical.initial(base_of(pictures), 0, 40).tensors()
    narrow = replace(of_functions(1, 1), feature_width=NARROW[0], hidden_width=NARROW[1])
    return FunctionsOnVolume(pictures, plan, start, GSSurrogateArchitecture(1, *NARROW), narrow)


def copied(fit: FunctionsOnVolume | GSSurrogate) -> dict[str, Tensor]:
    return {name: tensor.detach().clone() for name, tensor in fit.tensors().items()}


def layer(columns: int, rows: int, normalized: bool = True) -> int:
    return columns * rows + rows + 2 * rows * normalized


def count(architecture: GSSurrogateArchitecture) -> int:
    return sum(tensor.numel() for tensor in architecture.initial(np.random.default_rng(0)).values())


@pytest.mark.parametrize("parameters", [1, 3, 6])
def test_networks_have_as_many_numbers_as_the_authors_code(parameters: int) -> None:
    position = layer(63, 256) + layer(256, 256) + layer(256, 64, False)
    encoders = layer(parameters * 5, 256) + layer(256, 64, False) + layer(4 * 9, 256) + layer(256, 64, False)
    adapter = layer(128, 64) + layer(64, 64, False)
    backbone = layer(64, 256) + layer(256, 256)
    heads = 2 * layer(256, 256) + layer(256, 1, False) + layer(256, 48, False)
    assert count(of_functions(parameters, 4)) == position + encoders + adapter + backbone + heads
    isovalue = layer(5, 512) + layer(512, 128, False) + 128 * 128  # and as many columns more in the adapter
    joint = count(GSSurrogateArchitecture(parameters))
    assert count(GSSurrogateArchitecture(parameters, visualization=1)) == joint + isovalue


def modules_of(networks: Mapping[str, Tensor], name: str) -> nn.Sequential:
    """The layers of a perceptron as torch's modules."""
    layers: list[nn.Module] = []
    for number in range(3):
        prefix = f"{name}.{number}"
        if f"{prefix}.weights" in networks:
            linear = nn.Linear(*reversed(networks[f"{prefix}.weights"].shape))
            linear.load_state_dict({"weight": networks[f"{prefix}.weights"], "bias": networks[f"{prefix}.biases"]})
            layers.append(linear)
        if f"{prefix}.gains" in networks:
            norm = nn.LayerNorm(len(networks[f"{prefix}.gains"]))
            norm.load_state_dict({"weight": networks[f"{prefix}.gains"], "bias": networks[f"{prefix}.shifts"]})
            layers += [norm, nn.ReLU()]
    return nn.Sequential(*layers)


def encoded(values: Tensor, frequencies: int) -> Tensor:
    angles = [math.pi * 2.0**k * values[:, [d]].double() for d in range(values.shape[1]) for k in range(frequencies)]
    return torch.cat([values, *(a.sin() for a in angles), *(a.cos() for a in angles)], dim=1).float()


@torch.no_grad()
@pytest.mark.parametrize(
    ("architecture", "own"),
    [
        (replace(of_functions(2, 4), feature_width=NARROW[0], hidden_width=NARROW[1]), [0.0, -1.0, 0.25, 1.0]),
        (GSSurrogateArchitecture(2, *NARROW, visualization=1), [0.4]),
    ],
    ids=["functions", "isosurfaces"],
)
def test_offsets_are_those_of_the_published_network(architecture: GSSurrogateArchitecture, own: list[float]) -> None:
    random = np.random.default_rng(3)
    drawn = {name: random.normal(0.0, 0.3, t.shape) for name, t in architecture.initial(random).items()}
    networks = {name: torch.from_numpy(values).to(torch.float32) for name, values in drawn.items()}
    places, parameters = torch.from_numpy(random.uniform(-0.2, 0.2, (7, 3))).float(), torch.tensor([-0.5, 0.8, *own])
    found = gs_surrogate.offsets(networks, architecture, places, parameters)

    def part(name: str) -> nn.Sequential:
        return modules_of(networks, name)

    of_simulation = part("parameters")(encoded(torch.tensor([[0.25, 0.9]]), 2))
    functions = len(own) == 4
    scaled = torch.tensor([own]) if functions else (torch.tensor([own]) + 1.0) / 2.0
    of_own = part("visualization")(encoded(scaled, 4 if functions else 2))
    shift = part("adapter")(torch.cat([of_simulation, of_own], dim=1))
    features = part("backbone")(part("position")(encoded(places, 10)) + shift)
    assert set(found) == ({"opacity_logits", "harmonics"} if functions else set(gs_surrogate.COLUMNS))
    for name, offsets in found.items():
        expected = part(name)(features).tanh() if name == "opacity_logits" else part(name)(features)
        torch.testing.assert_close(offsets, expected, rtol=1e-4, atol=1e-4)


def test_the_volume_learns_the_base_alone_and_is_then_frozen() -> None:
    pictures, plan = varied(TWO_MEMBERS), Plan(9, seed=2)  # 4 of 9 steps are the volume's
    fit = begun(pictures, plan)
    alone = GSSurrogate(
        base_of(pictures),
        replace(plan, steps=4),
        canonical.initial(base_of(pictures), 0, 40).tensors(),
        GSSurrogateArchitecture(1, *NARROW),
    )
    before = copied(fit)
    assert [fit.advance() for _ in range(4)] == [alone.advance() for _ in range(4)]
    volume = copied(fit)
    for name, tensor in volume.items():
        assert torch.equal(tensor, before[name] if name.startswith("functions.") else alone.tensors()[name]), name
    losses = [fit.advance() for _ in range(5)]
    assert np.isfinite(losses).all()
    for name, tensor in copied(fit).items():
        assert torch.equal(tensor, volume[name]) != name.startswith("functions."), name


def test_functions_change_opacities_and_harmonics_alone() -> None:
    pictures = varied(TWO_MEMBERS)
    fit = begun(pictures, Plan(9))
    for _ in range(9):
        fit.advance()
    parameters = torch.tensor([-1.0, -1.0])
    volume = fit._volume_at(parameters)
    changed = fit._changed(volume, parameters)
    for name, tensor in changed.tensors().items():
        assert torch.equal(tensor, volume.tensors()[name]) != (name in ("opacity_logits", "harmonics")), name
    assert not torch.equal(fit._changed(volume, torch.tensor([-1.0, 1.0])).harmonics, changed.harmonics)
    camera = pictures.cameras[0]
    np.testing.assert_array_equal(fit.at(parameters)(camera), changed.picture(camera, None))


def test_a_function_is_learnt_from_a_fifth_of_the_members_and_the_base_from_all() -> None:
    members, functions = np.linspace(-1.0, 1.0, 11), [-1.0, -0.5, 0.0, 0.5, 1.0]
    pictures = varied([[m, f] for m in members for f in functions if (m, f) != (1.0, 0.5)], views=2)
    learnt = images_of_functions(pictures, 3)
    assert np.array_equal(learnt, images_of_functions(pictures, 3))
    assert not np.array_equal(learnt, images_of_functions(pictures, 4))
    rows = pictures.parameters[torch.from_numpy(learnt)].numpy()
    seen = {f: sorted(rows[rows[:, 1] == f, 0].tolist()) for f in functions}
    assert len(seen[0.0]) == 22
    for function in (-1.0, -0.5, 0.5, 1.0):
        assert len(seen[function]) == 4, "both views of each of two of eleven members"
        assert seen[function][0] == seen[function][1] < seen[function][2] == seen[function][3]
    assert len({tuple(of) for of in seen.values()}) > 2
    few = varied([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], views=1)
    assert len(images_of_functions(few, 0)) == 4


def test_rates_fall_as_torchs_cosine_does() -> None:
    adam = torch.optim.Adam([torch.zeros(1, requires_grad=True)], lr=2e-4)
    falling = torch.optim.lr_scheduler.CosineAnnealingLR(adam, T_max=7, eta_min=2e-5)
    for step in range(7):
        assert 2e-4 * cosine_decay(step / 7) == pytest.approx(adam.param_groups[0]["lr"])
        rates = gs_surrogate.rates(ISOSURFACES, Plan(7, rate=2.0), 5.5, step)
        assert rates["network"] == pytest.approx(adam.param_groups[0]["lr"])
        assert rates["means"] == pytest.approx(2.0 * 1.6e-4 * 0.001 * 5.0 * 0.1 ** (step / 7))
        adam.step()
        falling.step()


def test_the_colours_degree_grows_over_the_first_steps_of_the_functions(monkeypatch: pytest.MonkeyPatch) -> None:
    degrees = []
    picture = canonical.HarmonicGaussians.draw_over

    def noted(self: canonical.HarmonicGaussians, *given: object, degree: int = 3) -> Tensor:
        degrees.append(degree)
        return picture(self, *given, degree=degree)  # type: ignore[arg-type]

    monkeypatch.setattr(gs_surrogate_separate, "GROWTH", 20_000)
    fit = begun(varied(TWO_MEMBERS), Plan(18))  # 8 steps of the volume and 10 of the functions
    monkeypatch.setattr(canonical.HarmonicGaussians, "draw_over", noted)
    for _ in range(18):
        fit.advance()
    assert degrees == [3] * 8 + [0, 0, 1, 1, 2, 2, 3, 3, 3, 3]


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_short_plans_train(steps: int) -> None:
    fit = begun(varied(TWO_MEMBERS), Plan(steps))
    assert np.isfinite([fit.advance() for _ in range(steps)]).all()
    assert np.isfinite(fit.at(torch.tensor([0.3, -0.2]))(fit._pictures.cameras[0])).all()


def test_isosurfaces_share_the_chances_of_a_member_and_an_isovalue() -> None:
    pictures = varied([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0]], views=3)
    start = canonical.initial(pictures, 0, 40).tensors()
    fit = of_isosurfaces(pictures, Plan(4), start, GSSurrogateArchitecture(1, *NARROW, visualization=1))
    losses = [fit.advance() for _ in range(4)]
    assert np.isfinite(losses).all()
    assert fit.state()["mining.losses"].shape == (3,)
    assert fit.tensors()["network.visualization.0.weights"].shape == (16, 5)
    still = [name for name, tensor in fit.tensors().items() if name in start and torch.equal(tensor, start[name])]
    assert still == [], "the canonical Gaussians learn too"


def test_images_without_what_a_network_is_made_for_are_refused() -> None:
    plain, without_base = ball_pictures([[-1.0], [1.0]], views=1, size=12), varied([[-1.0, 1.0]], views=1)
    start = canonical.initial(plain, 0, 20).tensors()
    for method in (FOR_FUNCTIONS, FOR_ISOSURFACES):
        with pytest.raises(ValueError, match="needs images in which these vary"):
            method.begin(plain, Plan(2), start)
    with pytest.raises(ValueError, match="needs images of the base: all 1 show other functions"):
        FOR_FUNCTIONS.begin(without_base, Plan(2), start)


@pytest.mark.slow
def test_functions_are_learnt() -> None:
    """Darker and lighter balls: what the frozen volume can't show, its opacities can."""
    pictures = varied([[-1.0, 0.0], [1.0, 0.0], [-1.0, 1.0], [1.0, 1.0]], views=2)
    faint = pictures.pixels.copy()
    faint[4:] = faint[[0, 1, 2, 3]] // 2
    pictures = replace(pictures, pixels=faint)
    start = canonical.prepare(base_of(pictures), 0, count=40, steps=60)
    narrow = replace(of_functions(1, 1), feature_width=16, hidden_width=32)
    fit = FunctionsOnVolume(pictures, Plan(180, rate=20.0), start, GSSurrogateArchitecture(1, 16, 32), narrow)
    for _ in range(80):
        fit.advance()
    learnt = images_of_functions(pictures, 0)[-1]
    before = psnr_over(pictures, learnt, fit.at(pictures.parameters[learnt])(pictures.camera(learnt)))
    for _ in range(100):
        fit.advance()
    after = psnr_over(pictures, learnt, fit.at(pictures.parameters[learnt])(pictures.camera(learnt)))
    assert after > before + 3.0
