"""The deformation of GS-Surrogate (Li et al. 2026, arXiv:2604.06358): a network asked at every Gaussian's canonical position.

    feature(x, p) = s + adapter([s, e(p)]),   s = encoder of the position x,   e = encoder of the parameters p
    offsets(x, p) = heads(backbone(feature)),  a head for each attribute of the Gaussians

Compared with `BilinearDeformation` it stores nothing per Gaussian, and Gaussians that are near each other move alike; but the
whole network is evaluated for each Gaussian at each change of the parameters, which takes a hundred times as long.

The authors' published code lets the adapter see only e(p), which shifts all features alike; here it sees the position too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, NamedTuple

import torch
from numpy.random import Generator
from torch import Tensor
from torch.nn.functional import layer_norm, linear

from catalogs.vocabulary.words import one_line
from surrogate.appearance.field_gaussians import AnyGaussians
from surrogate.deformation.offsets import Offsets
from surrogate.deformation.positional import encode
from surrogate.gaussians import GEOMETRY, NAMES
from surrogate.randomness import generator
from surrogate.settings import TrainingSettings

POSITION_FREQUENCIES = 10  # in the encoding of a position; the highest has a period of 1/512 of half the box
PARAMETER_FREQUENCIES = 2  # in the encoding of a simulation parameter: few, so that offsets are smooth between members
FEATURE_WIDTH = 128  # numbers that describe a position, and the parameters
BACKBONE_WIDTH = 512  # of the two layers that all heads share
HEAD_WIDTH = (
    128  # of each head's hidden layer; the authors' is as wide as the backbone: nearly three times the time of a step
)
RATE = (
    3e-4  # Adam's for all networks (the authors: 1e-4); in 200 steps on a linear field of offsets 3e-3 learnt nothing
)


class _Layer(NamedTuple):
    """A linear map, which may be one of several `parts` side by side that are added: its initial size follows from all columns."""

    rows: int
    columns: int
    parts: int = 1
    biased: bool = True
    normalized: bool = False  # followed by a LayerNorm
    zero: bool = False  # at first

    def shapes(self) -> dict[str, tuple[int, ...]]:
        shapes: dict[str, tuple[int, ...]] = {"weights": (self.rows, self.columns)}
        vectors = ["biases"] * self.biased + ["gains", "shifts"] * self.normalized
        return shapes | dict.fromkeys(vectors, (self.rows,))

    def initial(self, random: Generator) -> dict[str, Tensor]:
        """Uniform within 1 / sqrt(columns), as in `torch.nn.Linear` (He et al. 2015 with a = sqrt 5)."""
        bound = 0.0 if self.zero else 1.0 / math.sqrt(max(self.parts * self.columns, 1))
        constants = {"gains": 1.0, "shifts": 0.0}
        return {
            name: torch.full(shape, constants[name])
            if name in constants
            else torch.from_numpy(random.uniform(-bound, bound, shape)).to(torch.float32)
            for name, shape in self.shapes().items()
        }


@dataclass(frozen=True)
class Architecture:
    """Which networks there are and how wide they are.

    Attributes
    ----------
    parameters : how many the ensemble has.
    heads : the attributes of the Gaussians that move, of `NAMES` and in their order.
    color_columns : how many of the colours' columns move.
    anchored : so many of the last parameters; where they are zero nothing moves, for which two networks' outputs are compared.
    position_frequencies, parameter_frequencies : of the encodings.
    feature_width, backbone_width, head_width : without a backbone (width 0), heads act on features.
    bfloat16 : whether what is computed per Gaussian is computed in bfloat16.  Gradients are then some percent off, up to 20 % where
        the Gaussians' contributions nearly cancel; it pays only on processors and GPUs that multiply in bfloat16.
    """

    parameters: int
    heads: tuple[str, ...] = NAMES
    color_columns: int = 3
    anchored: int = 0
    position_frequencies: int = POSITION_FREQUENCIES
    parameter_frequencies: int = PARAMETER_FREQUENCIES
    feature_width: int = FEATURE_WIDTH
    backbone_width: int = BACKBONE_WIDTH
    head_width: int = HEAD_WIDTH
    bfloat16: bool = False

    __repr__ = one_line

    def __post_init__(self) -> None:
        if self.heads != tuple(name for name in NAMES if name in self.heads):
            raise ValueError(f"heads must be some of {NAMES} in this order, got {self.heads}")
        smallest = {"color_columns": 1, "feature_width": 1, "head_width": 1}
        if self.color_columns not in (3, 12):
            raise ValueError(f"color_columns must be 3 or 12, got {self.color_columns!r}")
        for name, value in asdict(self).items():
            if name not in ("heads", "bfloat16") and (type(value) is not int or value < smallest.get(name, 0)):
                raise ValueError(f"{name} can't be {value!r}")
        if self.anchored > self.parameters:
            raise ValueError(f"anchored must be at most {self.parameters}, all parameters, got {self.anchored}")
        if type(self.bfloat16) is not bool:
            raise ValueError(f"bfloat16 can't be {self.bfloat16!r}")

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Architecture:
        """The architecture that had these `asdict` values; raises ValueError where one is missing or impossible."""
        missing = sorted(set(cls.__dataclass_fields__) - set(record))
        if missing:
            raise ValueError(f"the record of a deformation field lacks {missing}")
        values = {name: record[name] for name in cls.__dataclass_fields__}
        if not isinstance(values["heads"], list | tuple):
            raise ValueError(f"heads must be a list, got {values['heads']!r}")
        return cls(**values | {"heads": tuple(values["heads"])})

    def columns(self, attribute: str) -> int:
        """How many columns of this attribute move."""
        return GEOMETRY.get(attribute, self.color_columns)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape of each tensor, by name."""
        return {f"{layer}.{part}": shape for layer, of in self._layers().items() for part, shape in of.shapes().items()}

    def initial(self, random: Generator) -> dict[str, Tensor]:
        """Random tensors with which nothing moves yet."""
        return {f"{layer}.{part}": t for layer, of in self._layers().items() for part, t in of.initial(random).items()}

    def _layers(self) -> dict[str, _Layer]:
        feature, backbone = self.feature_width, self.backbone_width
        if not self.heads:
            return {}
        layers = {
            "position": _Layer(feature, 3 * (1 + 2 * self.position_frequencies), normalized=True),
            "parameters_in": _Layer(feature, self.parameters * (1 + 2 * self.parameter_frequencies)),
            "parameters_out": _Layer(feature, feature),
            "adapter_position": _Layer(feature, feature, parts=2),
            "adapter_parameters": _Layer(feature, feature, parts=2, biased=False),
            "adapter_out": _Layer(feature, feature),
        }
        if backbone:
            layers["backbone_in"] = _Layer(backbone, feature, normalized=True)
            layers["backbone_out"] = _Layer(backbone, backbone, normalized=True)
        for name in self.heads:
            layers[f"{name}_in"] = _Layer(self.head_width, backbone or feature)
            layers[f"{name}_out"] = _Layer(self.columns(name), self.head_width, zero=True)
        return layers


@dataclass(frozen=True, eq=False)
class FieldDeformation:
    """The networks' tensors by name, and the size of one unit of each attribute's offset.

    The opacity's output passes a tanh: its logit changes by less than one unit.
    """

    networks: Mapping[str, Tensor]
    architecture: Architecture
    units: Mapping[str, float]

    kind: ClassVar[str] = "paper"
    per_gaussian: ClassVar[frozenset[str]] = frozenset()

    __repr__ = one_line

    @classmethod
    def create(
        cls,
        gaussians: AnyGaussians,
        parameters: int,
        settings: TrainingSettings,
        *,
        anchored: int = 0,
        color_columns: int = 3,
        for_visualization: bool = False,
    ) -> FieldDeformation:
        """Random networks with last layers of zero: nothing moves, but the gradient is not zero.

        Parameters as in `BilinearDeformation.create`.  F_vis is without a backbone, as the paper's is.
        """
        architecture = Architecture(
            parameters,
            color_columns=color_columns,
            anchored=anchored,
            backbone_width=0 if for_visualization else BACKBONE_WIDTH,
            bfloat16=settings.designs.precision == "bfloat16",
        )
        units = {name: getattr(settings.units, name) for name in NAMES}
        return cls(architecture.initial(generator(settings.seed, "latents")), architecture, units)

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> FieldDeformation:
        """The deformation of `stored()` and `record()`; raises ValueError where they do not belong together."""
        architecture, units = Architecture.of_record(record), _checked_units(record.get("units"))
        expected = architecture.shapes()
        if set(tensors) != set(expected):
            raise ValueError(f"a deformation field's tensors differ in {sorted(set(tensors) ^ set(expected))}")
        for name, shape in expected.items():
            found = tensors[name]
            if tuple(found.shape) != shape or not found.is_floating_point():
                raise ValueError(f"{name} must be real of shape {shape}, got {found.dtype}, {tuple(found.shape)}")
        return cls({name: tensors[name] for name in expected}, architecture, units)

    def offsets(self, gaussians: AnyGaussians, parameters: Tensor) -> Offsets:
        """Offsets at normalized `parameters` (P,), from the Gaussians' means alone."""
        means = gaussians.means.detach()  # [N, 3]; the gradient through 2^9 pi x would drown that of the picture
        found = self._found(means, parameters) if self.architecture.heads else {}
        tables = {name: found.get(name, means.new_zeros(len(means), self.architecture.columns(name))) for name in NAMES}
        return Offsets(**tables | {"opacity_logits": tables["opacity_logits"].squeeze(1)})

    def deformed(self, gaussians: AnyGaussians, parameters: Tensor) -> AnyGaussians:
        """The Gaussians with their offsets."""
        return self.offsets(gaussians, parameters).applied_to(gaussians)

    def tensors(self) -> dict[str, Tensor]:
        """Everything that is trained, by name."""
        return dict(self.networks)

    def stored(self) -> dict[str, Tensor]:
        """`tensors()`, for what holds still has none."""
        return self.tensors()

    def moves(self, attribute: str) -> bool:
        """Whether this attribute has a head."""
        return attribute in self.architecture.heads

    def without(self, attribute: str) -> FieldDeformation:
        """The same without the attribute's head; without the last, no network is left."""
        heads = tuple(name for name in self.architecture.heads if name != attribute)
        architecture = replace(self.architecture, heads=heads)
        kept = {name: self.networks[name] for name in architecture.shapes()}
        return replace(self, networks=kept, architecture=architecture)

    def of(self, rows: Tensor) -> FieldDeformation:
        """The same, for it knows Gaussians by their position only."""
        return self

    def to(self, device: torch.device | torch.dtype) -> FieldDeformation:
        """The same on another device, or in another precision."""
        return self.with_tensors({name: tensor.to(device) for name, tensor in self.networks.items()})

    def copy(self) -> FieldDeformation:
        """The same numbers in tensors of their own."""
        return self.with_tensors({name: tensor.detach().clone() for name, tensor in self.networks.items()})

    def with_tensors(self, tensors: Mapping[str, Tensor]) -> FieldDeformation:
        """The same with others for all of `tensors`."""
        return replace(self, networks=dict(tensors))

    @property
    def latent_size(self) -> int:
        """1: there are no numbers per Gaussian that could become fewer."""
        return 1

    def reduced(self, size: int, places: Sequence[Tensor]) -> FieldDeformation:
        """The same."""
        return self

    def rates(self, settings: TrainingSettings) -> dict[str, float]:
        """Adam's rate for each of `tensors`."""
        return dict.fromkeys(self.networks, RATE)

    def record(self) -> dict[str, Any]:
        """The kind, the architecture, and the offset units by attribute."""
        architecture = asdict(self.architecture)
        return {"kind": self.kind} | architecture | {"heads": list(self.architecture.heads), "units": dict(self.units)}

    def _found(self, means: Tensor, parameters: Tensor) -> dict[str, Tensor]:
        """The offsets (N, columns) of what moves."""
        architecture, anchored = self.architecture, self.architecture.anchored
        encoded = encode(means.to(self.networks["position.weights"]), architecture.position_frequencies)  # [N, 63]
        space = self._layer("position", self._narrowed(encoded)).relu_()  # [N, F]
        outputs = self._outputs(self._features(space, parameters))  # [N, C]
        if anchored:
            anchor = torch.cat([parameters[:-anchored], torch.zeros_like(parameters[-anchored:])])  # [P]
            outputs = outputs - self._outputs(self._features(space, anchor))
        columns = [architecture.columns(name) for name in architecture.heads]
        found = dict(zip(architecture.heads, outputs.split(columns, dim=1), strict=True))
        if "opacity_logits" in found:
            found["opacity_logits"] = found["opacity_logits"].tanh()
        return {name: table * self.units[name] for name, table in found.items()}

    def _features(self, space: Tensor, parameters: Tensor) -> Tensor:
        """What the heads look at, (N, backbone or feature width), from the positions' features (N, F)."""
        bias = self._adapter_bias(parameters)  # [F]
        hidden = linear(space, self._cast("adapter_position.weights", space), self._narrowed(bias))  # [N, F]
        features = space + self._layer("adapter_out", hidden.relu_())  # [N, F]
        if not self.architecture.backbone_width:
            return features
        wide = self._layer("backbone_in", features).relu_()  # [N, B]
        return self._layer("backbone_out", wide).relu_()  # [N, B]

    def _adapter_bias(self, parameters: Tensor) -> Tensor:
        """What the parameters add to the adapter's first layer, (F,): once for all Gaussians, and always in full precision."""
        given = parameters.to(self.networks["parameters_in.weights"])  # [P]
        encoded = encode(given[None], self.architecture.parameter_frequencies)  # [1, 5 P]
        feature = self._layer("parameters_out", self._layer("parameters_in", encoded).relu_())  # [1, F]
        return linear(
            feature, self.networks["adapter_parameters.weights"], self.networks["adapter_position.biases"]
        ).squeeze(0)

    def _outputs(self, features: Tensor) -> Tensor:
        """The heads' outputs side by side, (N, C): all heads in two products, the second with a block for each."""
        heads = self.architecture.heads
        first = {part: torch.cat([self.networks[f"{n}_in.{part}"] for n in heads]) for part in ("weights", "biases")}
        blocks = torch.block_diag(*(self.networks[f"{name}_out.weights"] for name in heads))  # [C, H heads]
        biases = torch.cat([self.networks[f"{name}_out.biases"] for name in heads])  # [C]
        hidden = linear(features, first["weights"].to(features), first["biases"].to(features)).relu_()  # [N, H heads]
        return linear(hidden, blocks.to(hidden), biases.to(hidden)).to(blocks)

    def _layer(self, name: str, inputs: Tensor) -> Tensor:
        """One linear layer, normalized if it has gains, in the precision of the `inputs` (N, columns): (N, rows)."""
        outputs = linear(inputs, self._cast(f"{name}.weights", inputs), self._cast(f"{name}.biases", inputs))
        if f"{name}.gains" not in self.networks:
            return outputs
        gains, shifts = self._cast(f"{name}.gains", inputs), self._cast(f"{name}.shifts", inputs)  # [rows]
        if outputs.dtype == torch.bfloat16:  # torch sums the gradient of gains in bfloat16: 20,000 rows lose 80 % of it
            return torch.addcmul(shifts, layer_norm(outputs, outputs.shape[1:]), gains)
        return layer_norm(outputs, outputs.shape[1:], gains, shifts)

    def _cast(self, name: str, like: Tensor) -> Tensor:
        return self.networks[name].to(like.dtype)

    def _narrowed(self, tensor: Tensor) -> Tensor:
        return tensor.bfloat16() if self.architecture.bfloat16 else tensor


def _checked_units(units: Any) -> dict[str, float]:
    if isinstance(units, Mapping) and set(units) == set(NAMES):
        found = {name: units[name] for name in NAMES}
        if all(isinstance(unit, int | float) and math.isfinite(unit) for unit in found.values()):
            return found
    raise ValueError(f"the record of a deformation field must have units for {NAMES}, got {units!r}")
