"""The default deformation: offsets bilinear in a latent vector per Gaussian and an embedding of the parameters.

    Δ_i(p) = z_i · E(p),   z_i ∈ R^L per Gaussian,   E(p) ∈ R^(L x C) from a small network P -> hidden -> L C

So E(p) holds L modes of deformation, each a change of all C parameters of a Gaussian, and z_i says how much of each
mode Gaussian i follows.  Changing the parameters costs one small network for the whole ensemble and one product
(N, L) x (L, C); there is no network per Gaussian.  It cannot express a Gaussian whose offset is not a combination of
the L modes that all share.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

import native
from surrogate.deformation.offsets import Offsets
from surrogate.gaussians import Gaussians
from surrogate.sampling import generator
from surrogate.settings import TrainingSettings
from surrogate.splatting.cpu import cores


@dataclass(frozen=True, eq=False)
class BilinearDeformation:
    """Latents and embedding network; `units` (C,) scales the network's output to the size of each offset."""

    latents: Tensor  # [N, L]
    weights_in: Tensor  # [hidden, P]
    biases_in: Tensor  # [hidden]
    weights_out: Tensor  # [L * C, hidden]
    biases_out: Tensor  # [L * C]
    units: Tensor  # [C]

    kind: ClassVar[str] = "bilinear"
    per_gaussian: ClassVar[frozenset[str]] = frozenset({"latents"})

    @classmethod
    def create(cls, gaussians: Gaussians, parameters: int, settings: TrainingSettings) -> BilinearDeformation:
        """Random latents and first layer, zero last layer: nothing moves, but the gradient is not zero."""
        count, hidden, latent = len(gaussians), settings.hidden_width, settings.latent_size
        units = _units(settings, gaussians.colors.shape[1])  # [C]
        random = generator(settings.seed, "latents")
        bound = 1.0 / math.sqrt(max(parameters, 1))
        return cls(
            latents=_float32(settings.latent_spread * random.standard_normal((count, latent))),
            weights_in=_float32(random.uniform(-bound, bound, (hidden, parameters))),
            biases_in=_float32(random.uniform(-bound, bound, hidden)),
            weights_out=torch.zeros(latent * len(units), hidden),
            biases_out=torch.zeros(latent * len(units)),
            units=units,
        )

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> BilinearDeformation:
        """The deformation of `tensors()` and `record()`."""
        return cls(**tensors, units=torch.tensor(record["units"], dtype=torch.float32))

    def embedding(self, parameters: Tensor) -> Tensor:
        """The modes (L, C) at normalized `parameters` (P,)."""
        hidden = torch.nn.functional.silu(torch.addmv(self.biases_in, self.weights_in, parameters))  # [hidden]
        flat = torch.addmv(self.biases_out, self.weights_out, hidden)  # [L * C]
        return flat.view(self.latents.shape[1], len(self.units)) * self.units

    def offsets(self, gaussians: Gaussians, parameters: Tensor) -> Offsets:
        """Offsets at normalized `parameters` (P,); the Gaussians themselves do not matter to this deformation."""
        table = self.latents @ self.embedding(parameters)  # [N, C]
        means, log_scales, quats, opacity_logits, colors = table.split([3, 3, 4, 1, len(self.units) - 11], dim=1)
        return Offsets(means, log_scales, quats, opacity_logits.squeeze(1), colors)

    def deformed(self, gaussians: Gaussians, parameters: Tensor) -> Gaussians:
        """The Gaussians with their offsets: on a CPU in float32 by the kernel, else as `offsets` defines it."""
        if self.latents.is_cpu and self.latents.dtype == torch.float32:
            return Gaussians(
                *_AddProducts.apply(self.latents, self.embedding(parameters), *gaussians.tensors().values())
            )
        return self.offsets(gaussians, parameters).applied_to(gaussians)

    def tensors(self) -> dict[str, Tensor]:
        """Everything that is trained, by name."""
        names = ("latents", "weights_in", "biases_in", "weights_out", "biases_out")
        return {name: getattr(self, name) for name in names}

    def rates(self, settings: TrainingSettings) -> dict[str, float]:
        """Adam's rate for each of `tensors`."""
        return {n: settings.latent_rate if n == "latents" else settings.embedding_rate for n in self.tensors()}

    def record(self) -> dict[str, Any]:
        """The offset units (C,), which are not trained."""
        return {"units": self.units.tolist()}


class _AddProducts(torch.autograd.Function):
    """latents (N, L) times modes (L, C), added to five tensors with C columns in all, by the C++ kernel.

    torch takes 1.1 ms for each of the three products (N = 20,000, L = 16, C = 14), which are too narrow for its kernels.
    """

    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> tuple[Tensor, ...]:
        latents, modes, *_ = inputs
        ctx.save_for_backward(latents, modes)
        arrays = [tensor.detach().contiguous().numpy() for tensor in inputs]
        return tuple(map(torch.from_numpy, native.add_bilinear(arrays[0], arrays[1], arrays[2:], cores())))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, ...]:
        latents, modes = (tensor.detach().contiguous().numpy() for tensor in ctx.saved_tensors)
        arrays = [gradient.contiguous().numpy() for gradient in gradients]
        by_latents, by_modes = native.bilinear_gradients(latents, modes, arrays, cores())
        return torch.from_numpy(by_latents), torch.from_numpy(by_modes), *gradients


def _units(settings: TrainingSettings, color_columns: int) -> Tensor:
    """The size of one unit of each of a Gaussian's C parameters, (C,)."""
    return torch.tensor(
        [settings.mean_offset] * 3
        + [settings.log_scale_offset] * 3
        + [settings.quat_offset] * 4
        + [settings.opacity_offset]
        + [settings.color_offset] * color_columns
    )


def _float32(array: Any) -> Tensor:
    return torch.from_numpy(array).to(torch.float32)
