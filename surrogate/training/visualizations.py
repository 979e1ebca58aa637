"""Stage 3, F_vis: the Gaussians of F_sim follow the visualization parameters; the canonical ones are frozen.

A transfer function changes only opacities and colours: F_sim is frozen too, and the base stays the same bit for bit.  With other
isovalues and fields everything moves, and a copy of F_sim is tuned together with F_vis.
"""

from __future__ import annotations

from torch import Tensor

from catalogs.appearance import VolumeRendering
from catalogs.variations import Variation
from surrogate.deformation import KINDS, Deformation
from surrogate.deformation.values import ValuesDeformation, placed_values
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings, VisualizationKind
from surrogate.training.source import Source
from surrogate.training.stages import Stage

FROZEN_BY_TRANSFER_FUNCTIONS = ("means", "log_scales", "quats")


def kind_of(variation: Variation, settings: TrainingSettings) -> VisualizationKind:
    """Which F_vis a variation gets; raises ValueError where the settings ask for one that does not fit it."""
    asked, edits = settings.designs.visualization, variation.edits_base
    if asked == "auto":
        return "values" if edits else "bilinear"
    if asked == "values" and not edits:
        raise ValueError(
            f'training.visualization_deformation = "values" applies transfer functions, but this catalog varies the '
            f"{variation.kind} of {variation.base}"
        )
    return asked


def new_visualization(
    gaussians: Gaussians,
    simulation: Deformation,
    variation: Variation,
    source: Source,
    color_degree: int = 0,
) -> Visualization:
    """An F_vis that changes nothing yet, on the Gaussians and F_sim as stage 2 left them.

    It will show Gaussians of `color_degree`, or of their own degree where that is higher.
    """
    settings, edits = source.settings, variation.edits_base  # F_sim is frozen where the base is edited
    kind, degree = kind_of(variation, settings), max(color_degree, gaussians.color_degree)
    if kind == "values":
        return Visualization(variation, _applied_functions(gaussians, variation, source), None, degree)
    wide = gaussians.with_color_degree(degree)
    deformation = KINDS[kind].create(
        wide,
        len(source.catalog.plan.space) + len(variation.space),
        settings,
        anchored=len(variation.space) if edits else 0,
        color_columns=wide.colors.shape[1],
        for_visualization=True,
    )
    for attribute in FROZEN_BY_TRANSFER_FUNCTIONS if edits else ():
        deformation = deformation.without(attribute)
    tuned = None if edits or not settings.rates.simulation_factor else simulation.copy()
    return Visualization(variation, deformation.to(gaussians.means.device), tuned, degree)


def _applied_functions(gaussians: Gaussians, variation: Variation, source: Source) -> ValuesDeformation:
    """An F_vis that applies transfer functions, from the base appearance and the field's histogram."""
    base = next(a for a in source.catalog.plan.appearances if a.name == variation.base)
    if not isinstance(base, VolumeRendering):
        raise ValueError(f"appearance {base.name} has no transfer function that could be varied")
    steps, function = [parameter.high for parameter in variation.space.parameters], base.transfer_function
    values = placed_values(source.settings.designs.value_bins, function.bounds, *source.histogram)
    return ValuesDeformation.create(gaussians, function, values, steps)


def visualization_stage(
    gaussians: Gaussians, simulation: Deformation, visualization: Visualization, settings: TrainingSettings
) -> Stage:
    """Optimize `visualization` in place: F_vis and, at a reduced rate, its own copy of F_sim where it has one."""
    of_vis, tuned = visualization.deformation, visualization.simulation
    parts = [("visualization.", of_vis, 1.0)]
    if tuned is not None:
        parts.append(("simulation.", tuned, settings.rates.simulation_factor))
    tensors = {prefix + name: t for prefix, part, _ in parts for name, t in part.tensors().items()}
    rates = {
        prefix + name: factor * rate for prefix, part, factor in parts for name, rate in part.rates(settings).items()
    }
    applied = isinstance(of_vis, ValuesDeformation)  # its offsets are as large as the transfer functions say
    known: dict[tuple[float, ...], Gaussians] = {}

    def rest_at(parameters: Tensor) -> Gaussians:
        alone = parameters[: -len(visualization.variation.space)]  # [P]
        if tuned is not None:
            return visualization.simulated(gaussians, simulation, alone)
        place = tuple(alone.tolist())
        if place not in known:  # F_sim is frozen: a member's Gaussians are always the same
            known[place] = visualization.simulated(gaussians, simulation, alone)
        return known[place]

    def gaussians_at(parameters: Tensor) -> Gaussians:
        if tuned is not None:
            return visualization.gaussians_at(gaussians, simulation, parameters)
        return of_vis.deformed(rest_at(parameters), parameters)

    return Stage(
        name=visualization.variation.kind,
        steps=settings.steps.visualization,
        tensors={name: tensor.requires_grad_() for name, tensor in tensors.items()},
        rates=rates,
        per_gaussian=frozenset(),
        gaussians_at=gaussians_at,
        rest_at=None if applied else rest_at,
    )
