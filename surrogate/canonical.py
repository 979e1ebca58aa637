"""Stage 1: one set of Gaussians that fits all members at once, as well as one can."""

from __future__ import annotations

from surrogate.gaussians import NAMES, Gaussians
from surrogate.settings import TrainingSettings
from surrogate.stage import Stage


def canonical_rates(settings: TrainingSettings) -> dict[str, float]:
    """Adam's rates for the tensors of `Gaussians`."""
    return {
        "means": settings.mean_rate,
        "log_scales": settings.log_scale_rate,
        "quats": settings.quat_rate,
        "opacity_logits": settings.opacity_rate,
        "colors": settings.color_rate,
    }


def canonical_stage(gaussians: Gaussians, settings: TrainingSettings) -> Stage:
    """Optimize `gaussians` in place; every member looks the same."""
    return Stage(
        name="canonical",
        steps=settings.canonical_steps,
        tensors={name: tensor.requires_grad_() for name, tensor in gaussians.tensors().items()},
        rates=canonical_rates(settings),
        per_gaussian=frozenset(NAMES),
        gaussians_at=lambda parameters: gaussians,
    )
