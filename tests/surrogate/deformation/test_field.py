import json
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
import safetensors.torch
import torch
from torch import Tensor, nn

from surrogate.deformation import Deformation, Offsets
from surrogate.deformation.field import Architecture, FieldDeformation
from surrogate.deformation.positional import encode
from surrogate.gaussians import NAMES, Gaussians
from surrogate.randomness import generator
from surrogate.settings import TrainingSettings
from surrogate.training.compression.choice import Measured
from surrogate.training.compression.choices import choose_modes
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.optimizer import Adam
from surrogate.training.stages import simulation_stage
from surrogate.training.state import Fitted

APPEARANCE = ("opacity_logits", "colors")
COLUMNS = {"means": 3, "log_scales": 3, "quats": 4, "opacity_logits": 1, "colors": 3}
SETTINGS = TrainingSettings()
UNITS = {
    "means": SETTINGS.units.means,
    "log_scales": SETTINGS.units.log_scales,
    "quats": SETTINGS.units.quats,
    "opacity_logits": SETTINGS.units.opacity_logits,
    "colors": SETTINGS.units.colors,
}


def canonical(count: int, color_columns: int = 3, dtype: torch.dtype = torch.float32) -> Gaussians:
    random = torch.Generator().manual_seed(1)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, color_columns))
    return Gaussians(*(2.0 * torch.rand(shape, generator=random, dtype=dtype) - 1.0 for shape in shapes))


def random_field(architecture: Architecture, dtype: torch.dtype = torch.float32) -> FieldDeformation:
    """Every tensor is random, also those that are constant at first; activations stay around 1."""
    random = torch.Generator().manual_seed(2)
    tensors = {}
    for name, shape in architecture.shapes().items():
        values = torch.randn(shape, generator=random, dtype=torch.float64) / math.sqrt(max(shape[-1], 1))
        tensors[name] = (values + name.endswith("gains")).to(dtype)
    return FieldDeformation(tensors, architecture, UNITS)


def small(parameters: int, **options: Any) -> Architecture:
    """Another width for each kind of layer, so that none can pass for another."""
    widths = {"feature_width": 6, "backbone_width": 9, "head_width": 5, "position_frequencies": 3}
    return Architecture(parameters, **(widths | options))


def flat(offsets: Offsets) -> Tensor:
    columns = (offsets.means, offsets.log_scales, offsets.quats, offsets.opacity_logits[:, None], offsets.colors)
    return torch.cat(columns, dim=1)


class Reference(nn.Module):
    """The same design layer by layer, as one would first write it."""

    def __init__(self, field: FieldDeformation) -> None:
        super().__init__()
        a, self.field = field.architecture, field
        width, wide = a.feature_width, a.backbone_width
        self.space = nn.Sequential(nn.Linear(3 + 6 * a.position_frequencies, width), nn.LayerNorm(width), nn.ReLU())
        self.parameters_in = nn.Linear(a.parameters * (1 + 2 * a.parameter_frequencies), width)
        self.parameters_out = nn.Linear(width, width)
        self.adapter = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), nn.Linear(width, width))
        shared = [(nn.Linear(n, wide), nn.LayerNorm(wide), nn.ReLU()) for n in (width, wide) if wide]
        self.backbone = nn.Sequential(*(layer for block in shared for layer in block))
        self.heads = nn.ModuleDict(
            {n: nn.Sequential(nn.Linear(wide or width, a.head_width), nn.ReLU(), nn.Linear(a.head_width, COLUMNS[n]))
             for n in a.heads}
        )  # fmt: skip
        self.double()
        self._take(self.space[0], "position")
        self._take(self.parameters_in, "parameters_in")
        self._take(self.parameters_out, "parameters_out")
        self._take(self.adapter[2], "adapter_out")
        halves = [field.networks[f"adapter_{half}.weights"].double() for half in ("position", "parameters")]
        self.adapter[0].weight.data = torch.cat(halves, dim=1)
        self.adapter[0].bias.data = field.networks["adapter_position.biases"].double()
        self._take_normalization(self.space[1], "position")
        if wide:
            for place, name in ((0, "backbone_in"), (3, "backbone_out")):
                self._take(self.backbone[place], name)
                self._take_normalization(self.backbone[place + 1], name)
        for name in a.heads:
            self._take(self.heads[name][0], f"{name}_in")  # type: ignore[index]
            self._take(self.heads[name][2], f"{name}_out")  # type: ignore[index]

    def _take(self, layer: nn.Module, name: str) -> None:
        layer.weight.data = self.field.networks[f"{name}.weights"].double()
        layer.bias.data = self.field.networks[f"{name}.biases"].double()

    def _take_normalization(self, layer: nn.Module, name: str) -> None:
        layer.weight.data = self.field.networks[f"{name}.gains"].double()
        layer.bias.data = self.field.networks[f"{name}.shifts"].double()

    def forward(self, means: Tensor, parameters: Tensor) -> Tensor:
        a = self.field.architecture
        space = self.space(self._encoded(means, a.position_frequencies))
        given = self._encoded(parameters[None].expand(len(means), -1), a.parameter_frequencies)
        known = self.parameters_out(torch.relu(self.parameters_in(given)))
        features = space + self.adapter(torch.cat([space, known], dim=1))
        features = self.backbone(features) if a.backbone_width else features
        found = []
        for name in NAMES:
            if name not in a.heads:
                found.append(means.new_zeros(len(means), COLUMNS[name]))
                continue
            output = self.heads[name](features)
            found.append(UNITS[name] * (torch.tanh(output) if name == "opacity_logits" else output))
        return torch.cat(found, dim=1)

    @staticmethod
    def _encoded(points: Tensor, frequencies: int) -> Tensor:
        angles = [2.0**k * math.pi * points[:, d] for d in range(points.shape[1]) for k in range(frequencies)]
        columns = [*points.unbind(1), *(angle.sin() for angle in angles), *(angle.cos() for angle in angles)]
        return torch.stack(columns, dim=1)


@pytest.mark.parametrize("backbone_width", [0, 9])
@pytest.mark.parametrize("heads", [NAMES, APPEARANCE, ("quats",)])
@pytest.mark.parametrize("parameters", [1, 3])
def test_offsets_and_gradients_are_those_of_plain_layers(
    backbone_width: int, heads: tuple[str, ...], parameters: int
) -> None:
    architecture = small(parameters, heads=heads, backbone_width=backbone_width)
    field, gaussians = random_field(architecture, torch.float64), canonical(20, dtype=torch.float64)
    p = torch.linspace(-0.9, 0.7, parameters, dtype=torch.float64)
    for tensor in field.networks.values():
        tensor.requires_grad_()
    reference = Reference(field)
    found, expected = flat(field.offsets(gaussians, p)), reference(gaussians.means, p)
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-12)
    weights = torch.arange(found.numel(), dtype=torch.float64).view_as(found).sin()  # of a linear loss
    (found * weights).sum().backward()
    (expected * weights).sum().backward()
    by_halves = reference.adapter[0].weight.grad.split(architecture.feature_width, dim=1)
    pairs = [
        ("position.weights", reference.space[0].weight.grad),
        ("position.gains", reference.space[1].weight.grad),
        ("parameters_in.weights", reference.parameters_in.weight.grad),
        ("adapter_position.weights", by_halves[0]),
        ("adapter_parameters.weights", by_halves[1]),
        ("adapter_position.biases", reference.adapter[0].bias.grad),
        (f"{heads[-1]}_out.weights", reference.heads[heads[-1]][2].weight.grad),  # type: ignore[index]
        (f"{heads[0]}_in.biases", reference.heads[heads[0]][0].bias.grad),  # type: ignore[index]
    ]
    for name, gradient in pairs:
        torch.testing.assert_close(field.networks[name].grad, gradient, rtol=0, atol=1e-11)


def test_the_networks_of_the_paper_in_float32_are_those_of_plain_layers_in_float64() -> None:
    made = FieldDeformation.create(canonical(0), 2, SETTINGS)
    assert made.networks["position.weights"].shape == (128, 63)
    assert made.networks["backbone_out.weights"].shape == (512, 512)
    field, gaussians, p = random_field(made.architecture), canonical(300), torch.tensor([0.3, -1.0])
    expected = Reference(field)(gaussians.means.double(), p.double())
    torch.testing.assert_close(flat(field.offsets(gaussians, p)).double(), expected, rtol=0, atol=5e-6)


def test_the_encoding_is_as_exact_as_float32_at_its_highest_frequency() -> None:
    points = canonical(1000).means
    found, exact = encode(points, 10), Reference._encoded(points.double(), 10)
    assert found.shape == (1000, 63)
    torch.testing.assert_close(found.double(), exact, rtol=0, atol=2.5e-7)


@pytest.mark.parametrize("parameters", [0, 1, 3])
@pytest.mark.parametrize("for_visualization", [False, True])
@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_it_starts_by_moving_nothing_yet_can_learn(parameters: int, for_visualization: bool, precision: Any) -> None:
    gaussians, settings = canonical(11, color_columns=12), SETTINGS.changed(field_precision=precision)
    field = FieldDeformation.create(gaussians, parameters, settings, for_visualization=for_visualization)
    for name in ("means", "log_scales", "quats") if for_visualization else ():  # as under transfer functions
        field = field.without(name)
    assert field.architecture.bfloat16 == (precision == "bfloat16")
    for tensor in field.tensors().values():
        tensor.requires_grad_()
    offsets = flat(field.offsets(gaussians, torch.linspace(-1, 1, parameters)))
    assert offsets.shape == (11, 14)  # how colours depend on the direction stays the same
    assert not offsets.any()
    offsets.sum().backward()
    for name in field.architecture.heads:
        gradient = field.networks[f"{name}_out.weights"].grad
        assert gradient is not None
        assert gradient.abs().mean() > 0.0
    assert {name: t.shape for name, t in field.networks.items()} == field.architecture.shapes()


def test_initial_sizes_are_those_of_torch_and_follow_the_seed() -> None:
    field, same = (FieldDeformation.create(canonical(1), 2, SETTINGS) for _ in range(2))
    other = FieldDeformation.create(canonical(1), 2, SETTINGS.changed(seed=1))
    assert all(torch.equal(tensor, same.networks[name]) for name, tensor in field.networks.items())
    assert not torch.equal(field.networks["position.weights"], other.networks["position.weights"])
    for name, columns in {"position": 63, "adapter_position": 256, "adapter_parameters": 256, "quats_in": 512}.items():
        theirs, ours = nn.Linear(columns, 4000).weight, field.networks[f"{name}.weights"]
        assert float(ours.abs().max()) == pytest.approx(float(theirs.detach().abs().max()), rel=0.01)
        assert float(ours.std()) == pytest.approx(float(theirs.detach().std()), rel=0.03)
        assert float(ours.mean()) == pytest.approx(0.0, abs=0.03 * float(ours.std()))


def test_gradients_agree_with_finite_differences() -> None:
    gaussians = canonical(3, dtype=torch.float64)
    field = random_field(
        small(2, feature_width=3, backbone_width=4, head_width=2, position_frequencies=1), torch.float64
    )
    names = list(field.tensors())

    def offsets(parameters: Tensor, *tensors: Tensor) -> Tensor:
        return flat(replace(field, networks=dict(zip(names, tensors, strict=True))).offsets(gaussians, parameters))

    inputs = [torch.tensor([0.1, -0.5], dtype=torch.float64), *field.tensors().values()]
    assert torch.autograd.gradcheck(offsets, [tensor.requires_grad_() for tensor in inputs], fast_mode=True)


def test_positions_learn_from_pictures_but_not_through_the_encoding() -> None:
    gaussians, field = canonical(8), random_field(small(1))
    gaussians.means.requires_grad_()
    for tensor in field.networks.values():
        tensor.requires_grad_()
    assert flat(field.offsets(gaussians, torch.tensor([0.3]))).requires_grad
    (gradient,) = torch.autograd.grad(
        field.deformed(gaussians, torch.tensor([0.3])).means.square().sum() / 2.0, gaussians.means
    )
    torch.testing.assert_close(gradient, field.deformed(gaussians, torch.tensor([0.3])).means.detach())


def test_it_learns_offsets_that_depend_on_position_and_parameters() -> None:
    gaussians = canonical(40)
    architecture = Architecture(1, feature_width=32, backbone_width=32, head_width=32, position_frequencies=3)
    field = FieldDeformation(architecture.initial(generator(0, "latents")), architecture, UNITS)
    stage = simulation_stage(gaussians, field, SETTINGS.changed(canonical_rate_factor=1e-12))
    adam = Adam(stage.tensors, stage.rates, shared=stage.shared)

    def error(p: float) -> Tensor:
        wanted = 0.1 * p * gaussians.means.detach()[:, [1, 2, 0]]  # [N, 3]
        return (field.offsets(gaussians, torch.tensor([p])).means - wanted).square().mean()

    before = float(error(0.8).detach())
    for step in range(160):
        error(math.sin(step)).backward()  # type: ignore[no-untyped-call]
        adam.step(10.0)  # so small a network can be taught faster
    assert float(error(0.8).detach()) < 0.3 * before


@pytest.mark.parametrize("options", [{}, {"bfloat16": True}, {"backbone_width": 0, "heads": APPEARANCE}])
def test_it_survives_being_saved_bit_for_bit(options: dict[str, Any]) -> None:
    gaussians, field = canonical(5), random_field(small(2, **options))
    stored = safetensors.torch.load(safetensors.torch.save(field.stored()))
    record = json.loads(json.dumps(field.record()))
    loaded = FieldDeformation.load(stored, record)
    p = torch.tensor([0.2, 0.4])
    assert loaded.architecture == field.architecture
    assert loaded.record() == field.record()
    assert list(loaded.tensors()) == list(field.tensors())
    assert torch.equal(flat(loaded.offsets(gaussians, p)), flat(field.offsets(gaussians, p)))


@pytest.mark.parametrize(
    ("tensors", "message"),
    [
        ({"position.weights": None}, r"differ in \['position.weights'\]"),
        ({"latents": torch.zeros(3)}, r"differ in \['latents'\]"),
        ({"adapter_out.biases": torch.zeros(7)}, r"adapter_out.biases must be real of shape \(6,\), got .*\(7,\)"),
        ({"adapter_out.biases": torch.zeros(6, dtype=torch.int32)}, "must be real .* torch.int32"),
    ],
)
def test_tensors_of_another_design_are_refused(tensors: dict[str, Tensor | None], message: str) -> None:
    field = random_field(small(1))
    changed = {name: tensor for name, tensor in (field.stored() | tensors).items() if tensor is not None}
    with pytest.raises(ValueError, match=message):
        FieldDeformation.load(changed, field.record())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"heads": None}, r"lacks \['heads'\]"),
        ({"heads": ["colors", "means"]}, "in this order"),
        ({"heads": ["warp"]}, "heads must be some of"),
        ({"heads": 3}, "heads must be a list"),
        ({"head_width": -1}, "head_width can't be -1"),
        ({"parameters": 1.5}, "parameters can't be 1.5"),
        ({"anchored": 2}, "anchored must be at most 1"),
        ({"bfloat16": 1}, "bfloat16 can't be 1"),
        ({"parameters": 2}, "parameters_in.weights must be real of shape"),
        ({"units": {"means": 0.1}}, "must have units for"),
        ({"units": dict.fromkeys(NAMES, "wide")}, "must have units for"),
    ],
)
def test_impossible_records_are_refused(changes: dict[str, Any], message: str) -> None:
    field = random_field(small(1))
    record = {name: value for name, value in (field.record() | changes).items() if value is not None}
    with pytest.raises(ValueError, match=message):
        FieldDeformation.load(field.stored(), record)


def test_an_attribute_that_is_held_still_leaves_the_others_and_takes_no_space() -> None:
    gaussians, whole, p = canonical(9, color_columns=12), random_field(small(1)), torch.tensor([0.3])
    without = whole.without("quats").without("colors")
    expected = flat(whole.offsets(gaussians, p)).clone()
    assert expected.abs().amin(0).gt(0.0).all()
    expected[:, 6:10] = 0.0
    expected[:, 11:] = 0.0
    found = flat(without.offsets(gaussians, p))
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-6)
    assert torch.equal(found == 0.0, expected == 0.0)
    assert [without.moves(name) for name in NAMES] == [True, True, False, True, False]
    gone = {
        f"{n}_{layer}.{part}" for n in ("quats", "colors") for layer in ("in", "out") for part in ("weights", "biases")
    }
    assert set(whole.stored()) - set(without.stored()) == gone
    deformed = without.deformed(gaussians, p)
    assert torch.equal(deformed.quats, gaussians.quats)
    assert torch.equal(deformed.colors, gaussians.colors)
    loaded = FieldDeformation.load(without.stored(), without.record())
    assert torch.equal(flat(loaded.offsets(gaussians, p)), found)
    assert without.without("quats").stored().keys() == without.stored().keys()


def test_nothing_moves_and_nothing_is_stored_where_every_attribute_is_held_still() -> None:
    gaussians, still = canonical(4, color_columns=12), random_field(small(1))
    for name in NAMES:
        still = still.without(name)
    loaded = FieldDeformation.load(still.stored(), still.record()).copy().to(torch.device("cpu"))
    assert not loaded.stored()
    assert not flat(loaded.offsets(gaussians, torch.tensor([0.7]))).any()
    deformed = loaded.deformed(gaussians, torch.tensor([0.7])).tensors()
    assert all(torch.equal(tensor, deformed[name]) for name, tensor in gaussians.tensors().items())


@pytest.mark.parametrize("bfloat16", [False, True])
@pytest.mark.parametrize(("count", "parameters"), [(0, 2), (3, 0), (0, 0), (1, 1)])
def test_no_gaussians_and_no_parameters_are_no_special_case(count: int, parameters: int, bfloat16: bool) -> None:
    gaussians, field = canonical(count), random_field(small(parameters, bfloat16=bfloat16))
    for tensor in field.networks.values():
        tensor.requires_grad_()
    deformed = field.deformed(gaussians, torch.zeros(parameters))
    assert [t.shape for t in deformed.tensors().values()] == [t.shape for t in gaussians.tensors().values()]
    sum((t.sum() for t in deformed.tensors().values()), torch.zeros(())).backward()
    for name, tensor in field.networks.items():
        assert tensor.grad is not None, name
        assert torch.isfinite(tensor.grad).all(), name
    loaded = FieldDeformation.load(field.stored(), field.record())
    assert loaded.architecture == field.architecture


def test_opacities_change_by_less_than_one_unit() -> None:
    gaussians, field = canonical(50), random_field(small(1))
    louder = {n: 100.0 * t if n == "opacity_logits_out.weights" else t for n, t in field.networks.items()}
    found = replace(field, networks=louder).offsets(gaussians, torch.tensor([0.5])).opacity_logits
    assert float(found.abs().max()) == pytest.approx(SETTINGS.units.opacity_logits, rel=1e-3)
    assert float(found.abs().max()) <= SETTINGS.units.opacity_logits


@pytest.mark.parametrize("anchored", [1, 2])
@pytest.mark.parametrize("bfloat16", [False, True])
def test_nothing_moves_at_the_anchor_and_elsewhere_it_is_the_difference(anchored: int, bfloat16: bool) -> None:
    gaussians, p = canonical(30), torch.tensor([0.3, -0.7])
    anchor = torch.cat([p[: 2 - anchored], torch.zeros(anchored)])
    plain = random_field(small(2, bfloat16=bfloat16))
    still = replace(plain, architecture=replace(plain.architecture, anchored=anchored))
    assert not flat(still.offsets(gaussians, anchor)).any()
    expected = flat(plain.offsets(gaussians, p)) - flat(plain.offsets(gaussians, anchor))
    found = flat(still.offsets(gaussians, p))
    others = [column for column in range(14) if column != 10]  # the opacity's difference is taken before its tanh
    torch.testing.assert_close(found[:, others], expected[:, others], rtol=0, atol=1e-6)
    assert found.abs().amax(0).gt(0.0).all()
    assert FieldDeformation.load(still.stored(), still.record()).architecture.anchored == anchored


def test_more_of_the_colours_may_move() -> None:
    gaussians = canonical(7, color_columns=12)
    made = FieldDeformation.create(gaussians, 2, SETTINGS, anchored=1, color_columns=12)
    assert made.architecture.anchored == 1
    field = random_field(small(2, color_columns=12))
    deformed = field.deformed(gaussians, torch.tensor([0.2, 0.1]))
    assert (deformed.colors != gaussians.colors).all()


def test_some_gaussians_move_as_they_do_among_all() -> None:
    gaussians, field, rows = canonical(12), random_field(small(2)), torch.tensor([7, 0, 3])
    p = torch.tensor([0.2, -0.6])
    some = flat(field.of(rows).offsets(gaussians.of(rows), p))
    torch.testing.assert_close(some, flat(field.offsets(gaussians, p))[rows], rtol=0, atol=1e-6)


def test_a_copy_has_tensors_of_its_own() -> None:
    field = random_field(small(1))
    copy = field.copy()
    copy.networks["position.weights"].zero_()
    assert field.networks["position.weights"].any()
    assert copy.per_gaussian == frozenset()
    assert field.to(torch.device("meta")).networks["position.weights"].is_meta
    assert set(field.rates(SETTINGS)) == set(field.tensors())


def test_it_has_no_modes_to_choose_from() -> None:
    fitted = Fitted(canonical(3), cast(Deformation, random_field(small(1))))
    evaluator = SimpleNamespace(
        measure=lambda fitted: Measured(30.0, 1.0, 1.0), tolerance=0.05, data=SimpleNamespace(examples=[])
    )
    chosen, choice = choose_modes(fitted, cast(Evaluator, evaluator))
    assert chosen is fitted
    assert choice.kept == "1"
    assert fitted.deformation.reduced(1, []) is fitted.deformation


@pytest.mark.parametrize(("coherent", "apart", "aligned"), [(True, 0.06, 0.998), (False, 0.25, 0.97)])
def test_bfloat16_is_near_enough_to_learn_from(coherent: bool, apart: float, aligned: float) -> None:
    """Root mean square errors of each tensor's gradient, and its cosine with that in float32.

    Activations near zero change sign, which counts where the Gaussians' contributions cancel (the second loss), not where
    they add up (the first).  There errors stay small unless sums over Gaussians are themselves taken in bfloat16.
    """
    gaussians, p = canonical(3000), torch.tensor([0.3])
    architecture, found = Architecture(1), []
    for bfloat16 in (False, True):
        field = random_field(replace(architecture, bfloat16=bfloat16))
        for tensor in field.networks.values():
            tensor.requires_grad_()
        offsets = flat(field.offsets(gaussians, p))
        assert offsets.dtype == torch.float32
        weights = torch.arange(offsets.numel()).view_as(offsets).sin()
        (offsets.square() if coherent else offsets * weights).sum().backward()
        found.append((offsets.detach(), {name: tensor.grad for name, tensor in field.networks.items()}))
    (exact_offsets, exact), (offsets, near) = found
    assert float((offsets - exact_offsets).norm() / exact_offsets.norm()) < 0.02
    for name, gradient in exact.items():
        other = near[name]
        assert gradient is not None
        assert other is not None
        error = float((other - gradient).norm() / gradient.norm())
        cosine = float(torch.nn.functional.cosine_similarity(other.flatten(), gradient.flatten(), dim=0))
        assert error < apart, f"{name} is {error:.1%} off"
        assert cosine > aligned, f"{name} has cosine {cosine:.4f}"
