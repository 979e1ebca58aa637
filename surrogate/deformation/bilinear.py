"""The default deformation: offsets bilinear in a latent vector per Gaussian and an embedding of the parameters.

    Δ_i(p) = z_i · E(p),   z_i ∈ R^L per Gaussian,   E(p) ∈ R^(L x C) from a small network P (1 + 2 K) -> hidden -> hidden -> L C

So E(p) holds L modes of deformation, each a change of all C parameters of a Gaussian, and z_i says how much of each
mode Gaussian i follows.  Changing the parameters costs one small network for the whole ensemble and one product
(N, L) x (L, C).  The second hidden layer is added to the first (He et al. 2016): with it members between the trained ones are
predicted better by far.

Carried values may follow an emulated field besides, see `surrogate.deformation.emulated_values`.

With K `frequencies` the network sees sines and cosines of pi, ... 2^(K - 1) pi times each parameter too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from catalogs.vocabulary.numbers import row
from catalogs.vocabulary.words import joined_names, one_line
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians
from surrogate.deformation.emulated_values import EXACT, PER_GAUSSIAN, EmulatedValues
from surrogate.deformation.kernels import Factors, add_products
from surrogate.deformation.offsets import UNITS, Deformation, Offsets
from surrogate.deformation.positional import encode
from surrogate.gaussians import GEOMETRY
from surrogate.randomness import generator
from surrogate.settings import MOST_FREQUENCIES, TrainingSettings

At = tuple[Deformation, Tensor]  # a deformation and normalized parameters (P,)
FIELD_COLUMNS = 13  # of a Gaussian's parameters where it carries values of a field
COLUMNS = (FIELD_COLUMNS, 14, 23)  # and with colours of degree 0 and 1
TENSORS = ("latents", "weights_in", "biases_in", "weights_out", "biases_out", "weights_middle", "biases_middle")
LATENT_SPREAD = 0.25  # standard deviation of the latents at the start
VISUALIZATION_MODES, VISUALIZATION_WIDTH = 16, 64
FIRST_SLOPES = 1.4  # of the hidden units, all parameters together; steeper ones predict members between worse
MOST_NUMBERS = 2**26  # of a network's last layer, spread
USUAL_SIZE, USUAL_WIDTH = 16, 64  # of the latent vectors and the hidden layer, for which the default rates were chosen


@dataclass(frozen=True, eq=False)
class BilinearDeformation:
    """Latents and embedding network; `units` (C,) scales the network's output to the size of each offset."""

    latents: Tensor  # [N, L]
    weights_in: Tensor  # [hidden, P (1 + 2 K)]
    biases_in: Tensor  # [hidden]
    weights_out: Tensor  # [L * C, hidden]
    biases_out: Tensor  # [L * C]
    weights_middle: Tensor  # [hidden, hidden], of the second hidden layer
    biases_middle: Tensor  # [hidden]
    units: Tensor  # [C]
    frequencies: int = 0  # K
    emulated: EmulatedValues | None = None  # that carried values follow besides

    kind: ClassVar[str] = "bilinear"

    __repr__ = one_line

    @property
    def per_gaussian(self) -> frozenset[str]:
        """The names in `tensors` that have one row per Gaussian."""
        return frozenset(("latents",) if self.emulated is None else ("latents", *PER_GAUSSIAN))

    @classmethod
    def create(
        cls,
        gaussians: AnyGaussians,
        parameters: int,
        settings: TrainingSettings,
        *,
        color_columns: int = 3,
        for_visualization: bool = False,
    ) -> BilinearDeformation:
        """Random latents and first layer, zero last layer: nothing moves, but the gradient is not zero.

        Parameters
        ----------
        parameters : how many it is a function of.
        color_columns : how many of the colours' columns may move; of values all do.
        for_visualization : whether it has the size of visualization deformations.
        """
        count, hidden, latent = len(gaussians), settings.hidden_width, settings.latent_size
        if for_visualization:
            hidden, latent = VISUALIZATION_WIDTH, VISUALIZATION_MODES
        units = _units(gaussians, color_columns)  # [C]
        random = generator(settings.seed, "latents")
        bound = min(1.0, FIRST_SLOPES / max(parameters, 1))
        frequencies = 0 if for_visualization else settings.parameter_frequencies
        inputs = parameters * (1 + 2 * frequencies)
        return cls(
            latents=_float32(LATENT_SPREAD * random.standard_normal((count, latent))),
            weights_in=_float32(random.uniform(-bound, bound, (hidden, inputs))),
            biases_in=_float32(random.uniform(-bound, bound, hidden)),
            weights_out=torch.zeros(latent * len(units), hidden),
            biases_out=torch.zeros(latent * len(units)),
            units=units,
            weights_middle=_float32(random.standard_normal((hidden, hidden)) / math.sqrt(hidden)),
            biases_middle=torch.zeros(hidden),
            frequencies=frequencies,
        )

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> BilinearDeformation:
        """The deformation of `stored()` and `record()`; raises ValueError where they do not belong together."""
        columns = len(record["units"]) if isinstance(record["units"], list) else 0
        if columns not in COLUMNS:
            raise ValueError(f"units must be a list of {' or '.join(map(str, COLUMNS))} numbers, got {columns}")
        units = torch.tensor(row(record["units"], columns, "units"), dtype=torch.float32)  # [C]
        emulated = None
        if record.get("emulated") is not None:
            emulated = EmulatedValues.load(tensors, record["emulated"])
            tensors = {name: t for name, t in tensors.items() if name not in (*PER_GAUSSIAN, *EXACT)}
        modes, inputs = _checked_sizes(tensors, columns, int((units != 0.0).sum()))
        frequencies = record.get("frequencies", 0)
        if type(frequencies) is not int or not 0 <= frequencies <= MOST_FREQUENCIES or inputs % (1 + 2 * frequencies):
            raise ValueError(
                f"frequencies must be a whole number from 0 to {MOST_FREQUENCIES}, K for a network of P (1 + 2 K) inputs, got "
                f"{frequencies!r} for one of {inputs}"
            )
        if emulated is not None and (emulated.parameters * (1 + 2 * frequencies), columns) != (inputs, FIELD_COLUMNS):
            raise ValueError("emulated values need Gaussians that carry values, and the parameters of the network")
        whole = {name: _spread(tensors[name], units != 0.0, modes) for name in ("weights_out", "biases_out")}
        return cls(**{**tensors, **whole}, units=units, frequencies=frequencies, emulated=emulated)

    def embedding(self, parameters: Tensor) -> Tensor:
        """The modes (L, C) at normalized `parameters` (P,)."""
        return self._modes(parameters) * self.units

    def _modes(self, parameters: Tensor) -> Tensor:
        place = parameters.to(self.weights_in.device)  # [P]
        flat = torch.addmv(self.biases_out, self.weights_out, self.hidden(place))  # [L * C]
        return flat.view(self.latents.shape[1], len(self.units))

    def hidden(self, place: Tensor) -> Tensor:
        """The input (hidden,) of the last layer at normalized parameters (P,)."""
        if self.frequencies:
            place = encode(place[None], self.frequencies)[0]  # [P (1 + 2 K)]
        hidden = torch.nn.functional.silu(torch.addmv(self.biases_in, self.weights_in, place))  # [hidden]
        return hidden + torch.nn.functional.silu(torch.addmv(self.biases_middle, self.weights_middle, hidden))

    def fixed(self, hidden: Tensor) -> BilinearDeformation:
        """The modes of an input (hidden,) of the last layer, at all parameters, without emulated values."""
        biases = torch.addmv(self.biases_out, self.weights_out, hidden)  # [L * C]
        return replace(self, weights_out=torch.zeros_like(self.weights_out), biases_out=biases, emulated=None)

    def offsets(self, gaussians: AnyGaussians, parameters: Tensor) -> Offsets:
        """Offsets at normalized `parameters` (P,); the Gaussians themselves do not matter to this deformation.

        Those of emulated values are left out; see `following`.
        """
        table = self.latents @ self.embedding(parameters)  # [N, C]
        means, log_scales, quats, opacity_logits, colors = table.split(
            [*GEOMETRY.values(), len(self.units) - 11], dim=1
        )
        return Offsets(means, log_scales, quats, opacity_logits.squeeze(1), colors)

    def stored(self) -> dict[str, Tensor]:
        """`tensors()` without the rows of frozen attributes."""
        used = self.units != 0.0  # [C]
        outputs = {"weights_out": self.weights_out, "biases_out": self.biases_out}
        modes = {name: t.unflatten(0, (self.latent_size, -1))[:, used].flatten(0, 1) for name, t in outputs.items()}
        return self.tensors() | modes | ({} if self.emulated is None else self.emulated.stored())

    def moves(self, attribute: str) -> bool:
        """True where this attribute follows the parameters."""
        return bool((self.units[self._columns(attribute)] != 0.0).any())

    def without(self, attribute: str) -> BilinearDeformation:
        """The same with zero for the attribute's units."""
        factors = torch.ones_like(self.units)  # [C]
        factors[self._columns(attribute)] = 0.0
        every = factors.repeat(self.latent_size)  # [L C]
        return replace(
            self,
            units=self.units * factors,
            emulated=None if attribute == "values" else self.emulated,
            weights_out=self.weights_out * every[:, None],
            biases_out=self.biases_out * every,
        )

    def of(self, rows: Tensor) -> BilinearDeformation:
        """The latents of some Gaussians, by index (M,), with the same modes."""
        return self.with_tensors({n: t[rows] if n in self.per_gaussian else t for n, t in self.tensors().items()})

    def to(self, device: torch.device | torch.dtype) -> BilinearDeformation:
        """The same on another device, or in another precision."""
        moved = self.with_tensors({name: tensor.to(device) for name, tensor in self.tensors().items()})
        return replace(moved, units=self.units.to(device))

    def copy(self) -> BilinearDeformation:
        """The same numbers in tensors of their own."""
        return self.with_tensors({name: tensor.detach().clone() for name, tensor in self.tensors().items()})

    def with_tensors(self, tensors: Mapping[str, Tensor]) -> BilinearDeformation:
        """The same with others for all of `tensors`."""
        own: dict[str, Any] = {name: tensors[name] for name in TENSORS}
        return replace(self, **own, emulated=self.emulated and self.emulated.with_tensors(tensors))

    @property
    def parameters(self) -> int:
        """P, how many it is a function of."""
        return self.weights_in.shape[1] // (1 + 2 * self.frequencies)

    @property
    def latent_size(self) -> int:
        """L, the number of modes."""
        return self.latents.shape[1]

    def widened(self, size: int, seed: int) -> BilinearDeformation:
        """With more modes, up to `size`: nothing moves otherwise yet, but the new ones can learn, as in `create`."""
        more = size - self.latent_size
        if more <= 0:
            return self
        latents = LATENT_SPREAD * generator(seed, "latents").standard_normal((len(self.latents), more))
        rows, (_, hidden) = more * len(self.units), self.weights_out.shape
        return replace(
            self,
            latents=torch.cat([self.latents, _float32(latents)], dim=1),
            weights_out=torch.cat([self.weights_out, torch.zeros(rows, hidden)]),
            biases_out=torch.cat([self.biases_out, torch.zeros(rows)]),
        )

    def reduced(self, size: int, places: Sequence[Tensor]) -> BilinearDeformation:
        """The `size` combinations of modes with which all offsets, in their units, change least at the parameters `places`.

        With G = sum over p of E(p) E(p)^T, offsets are Z E = (Z G^1/2) (G^-1/2 E).  Rows of the second factor have unit length over
        the places, so the singular values of the first rank the directions (Eckart & Young 1936).
        """
        if size >= self.latent_size:
            return self
        still = torch.where(self.units != 0.0, 1.0, 0.0)  # [C]
        modes = torch.cat([self._modes(place) * still for place in places], dim=1).double()  # [L, places C]
        values, vectors = torch.linalg.eigh(modes @ modes.T)  # [L], [L, L]
        strengths = values.clamp(min=0.0).sqrt()  # [L]
        inverse = torch.where(strengths > 1e-7 * strengths.max(), 1.0 / strengths, 0.0)  # [L]
        _, _, directions = torch.linalg.svd(self.latents.double() @ (vectors * strengths), full_matrices=False)
        chosen = directions[:size]  # [size, L]
        forth, back = (vectors * strengths) @ chosen.T, (chosen * inverse) @ vectors.T  # [L, size], [size, L]
        size_of = forth.norm(dim=0).clamp(min=1e-30) / math.sqrt(self.latent_size)  # [size]: latents keep their size
        forth, back = forth / size_of, back * size_of[:, None]
        shape = (self.latent_size, len(self.units))
        weights_out = torch.einsum(
            "kl,lch->kch", back, self.weights_out.double().unflatten(0, shape)
        )  # [size, C, hidden]
        biases_out = back @ self.biases_out.double().unflatten(0, shape)  # [size, C]
        return replace(
            self,
            latents=(self.latents.double() @ forth).float(),
            weights_out=weights_out.flatten(0, 1).float(),
            biases_out=biases_out.flatten().float(),
        )

    @property
    def has_kernel(self) -> bool:
        """True where the C++ kernel can add it: in main memory and float32."""
        return self.latents.is_cpu and self.latents.dtype == torch.float32

    def factors(self, parameters: Tensor) -> Factors:
        """The latents (N, L) and the modes (L, C) at normalized `parameters` (P,), whose product are the offsets."""
        return self.latents, self.embedding(parameters)

    def deformed(self, gaussians: AnyGaussians, parameters: Tensor) -> AnyGaussians:
        """The Gaussians with their offsets: on a CPU in float32 by the kernel, else as `offsets` defines it."""
        gaussians = self.following(gaussians, parameters)
        if self.has_kernel:
            return add_products(gaussians, [self.factors(parameters)])
        return self.offsets(gaussians, parameters).applied_to(gaussians)

    def following(self, gaussians: AnyGaussians, parameters: Tensor) -> AnyGaussians:
        """The Gaussians whose values follow the emulated field, where there is one; without the offsets."""
        if self.emulated is None or not isinstance(gaussians, FieldGaussians):
            return gaussians
        return self.emulated.added_to(gaussians, parameters)

    def tensors(self) -> dict[str, Tensor]:
        """Everything that is trained, by name."""
        return {name: getattr(self, name) for name in TENSORS} | (self.emulated.tensors() if self.emulated else {})

    def rates(self, settings: TrainingSettings) -> dict[str, float]:
        """Adam's rate for each of `tensors`: as the settings say up to `USUAL_SIZE` and `USUAL_WIDTH`, then less in proportion.

        Adam moves every number by about its rate.  Offsets are sums over modes, and modes over hidden units.  With equal rates
        wider sums move faster (48 modes of 128 units: to infinite scales in 2,000 steps).  `optimizer.surprise` keeps the second
        hidden layer from running away.
        """
        fewer, narrower = min(1.0, USUAL_SIZE / self.latent_size), min(1.0, USUAL_WIDTH / len(self.biases_in))
        hidden = settings.embedding_rate * narrower
        return dict.fromkeys(PER_GAUSSIAN if self.emulated else (), 0.0) | {
            "latents": settings.latent_rate * fewer,
            "weights_in": hidden,
            "biases_in": hidden,
            "weights_out": hidden * fewer,
            "biases_out": settings.embedding_rate * fewer,
            "weights_middle": hidden * narrower,
            "biases_middle": hidden,
        }

    def record(self) -> dict[str, Any]:
        """The kind and the offset units (C,), which are not trained; zero for frozen attributes."""
        frequencies = {"frequencies": self.frequencies} if self.frequencies else {}
        emulated = {"emulated": self.emulated.record()} if self.emulated else {}
        return {"kind": self.kind, "units": self.units.tolist()} | frequencies | emulated

    def _columns(self, attribute: str) -> slice:
        names = list(GEOMETRY)
        place = names.index(attribute) if attribute in names else len(names)  # colours and values are the last
        start = sum(GEOMETRY[name] for name in names[:place])
        return slice(start, start + GEOMETRY.get(attribute, len(self.units)))


def compose(gaussians: AnyGaussians, first: At, second: At) -> AnyGaussians:
    """The Gaussians deformed by `first`, and the result by `second`.

    Offsets of bilinear deformations do not depend on what they deform, so both are added at once, without storing what lies
    between; the result is the same bit for bit.
    """
    bilinear = [d for d, _ in (first, second) if isinstance(d, BilinearDeformation) and d.has_kernel]
    if len(bilinear) == 2:
        places = first[1], second[1]
        for own, place in zip(bilinear, places, strict=True):
            gaussians = own.following(gaussians, place)
        return add_products(gaussians, [d.factors(place) for d, place in zip(bilinear, places, strict=True)])
    for deformation, parameters in (first, second):
        gaussians = deformation.deformed(gaussians, parameters)
    return gaussians


def _units(gaussians: AnyGaussians, color_columns: int) -> Tensor:
    """The size of one unit of each of a Gaussian's C parameters that may move, (C,), `color_columns` of them of its colour."""
    widths = GEOMETRY | {"colors": color_columns, "values": 2}
    return torch.tensor([UNITS[name] for name in gaussians.tensors() for _ in range(widths[name])])


def _checked_sizes(tensors: Mapping[str, Tensor], columns: int, used: int) -> tuple[int, int]:
    """The numbers of modes and inputs of stored tensors; raises ValueError where their shapes do not fit together."""
    if set(tensors) != {*TENSORS}:
        raise ValueError(
            f"a bilinear deformation must consist of {joined_names(sorted(TENSORS))}, got {joined_names(sorted(tensors))}"
        )
    if tensors["latents"].ndim != 2 or tensors["weights_in"].ndim != 2:
        raise ValueError("latents and weights_in must have rows and columns")
    modes, (hidden, inputs) = tensors["latents"].shape[1], tensors["weights_in"].shape
    shapes: dict[str, tuple[int, ...]] = {
        "biases_in": (hidden,),
        "weights_out": (modes * used, hidden),
        "biases_out": (modes * used,),
        "weights_middle": (hidden, hidden),
        "biases_middle": (hidden,),
    }
    for name, shape in shapes.items():
        if tuple(tensors[name].shape) != shape:
            raise ValueError(f"{name} must be of shape {shape}, got {tuple(tensors[name].shape)}")
    if modes * columns * max(hidden, 1) > MOST_NUMBERS:
        raise ValueError(f"{modes} modes of {hidden} hidden units are more than a deformation can have")
    return modes, inputs


def _spread(tensor: Tensor, used: Tensor, modes: int) -> Tensor:
    """Rows (L M, ...) for the M used columns of each of L modes, among zeros for the others: (L C, ...)."""
    whole = tensor.new_zeros(modes, len(used), *tensor.shape[1:])  # [L, C, ...]
    whole[:, used] = tensor.reshape(modes, int(used.sum()), *tensor.shape[1:])
    return whole.flatten(0, 1)


def _float32(array: Any) -> Tensor:
    return torch.from_numpy(array).to(torch.float32)
