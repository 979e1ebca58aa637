"""Stage 3: visualization deformations, by which Gaussians follow the visualization parameters.

Gaussians that carry values are refined, with the simulation deformation, on pictures under all transfer functions.  In all other
cases those of the base stay as they are bit for bit.  There a transfer function changes only opacities and colours.  With other
fields everything moves, and a copy of the simulation deformation is tuned as well.  Isovalues have Gaussians of their own, which
start on points of the surfaces, learn what all have in common, then move with all parameters, and know the light on them.  Where
the field is emulated, they start on its surfaces, and move with these.
"""

from __future__ import annotations

from dataclasses import replace

from torch import Tensor

from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.variations import Variation
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.values import VALUE_BINS, ValuesDeformation, placed_values
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians
from surrogate.initialization.on_surfaces import EmulatedSurfaces
from surrogate.lighting import Lighting
from surrogate.settings import TrainingSettings
from surrogate.training.data import TrainingData
from surrogate.training.loop import StageRun
from surrogate.training.source import Source
from surrogate.training.stages import Stage, canonical_stage, shared_of, simulation_stage

SIMULATION_FACTOR = 0.1  # of the rates of the simulation deformation's copy that is tuned in stage 3
REFINEMENT_FACTOR = 0.3  # of all rates where Gaussians that carry values learn from more transfer functions
BEGUN_FACTOR = 0.2  # of all rates where Gaussians start on emulated surfaces: at full ones validation images got worse
STILL = 0.03  # of stage 3, for which Gaussians of its own do not move yet; without it half of them may die at once


def lighting_of(variation: Variation, source: Source) -> Lighting | None:
    """The light on the surfaces that a variation shows; None where it shows anything else, lit differently, or looks otherwise."""
    names = {setting.appearance for setting in variation.settings}
    lighting = Lighting.of([a for a in source.catalog.plan.appearances if a.name in names])
    return lighting if lighting is not None and lighting.explains(source.opaque_pixels(variation)) else None


def new_visualization(
    gaussians: AnyGaussians,
    simulation: BilinearDeformation,
    variation: Variation,
    source: Source,
    color_degree: int = 0,
    surfaces: EmulatedSurfaces | None = None,
) -> Visualization:
    """A visualization deformation that changes nothing yet, on the result of stage 2; lit surfaces may start on emulated ones.

    It will show Gaussians of `color_degree`, or of their own degree where that is higher.
    """
    lighting = lighting_of(variation, source)
    if lighting is not None:
        return _of_surfaces(lighting, variation, source, surfaces).to(gaussians.means.device)
    return shared_visualization(gaussians, simulation, variation, source, color_degree)


def shared_visualization(
    gaussians: AnyGaussians,
    simulation: BilinearDeformation,
    variation: Variation,
    source: Source,
    color_degree: int = 0,
) -> Visualization:
    """A visualization deformation that changes nothing yet, of the base's Gaussians, whatever the variation shows."""
    settings, edits = (
        source.settings,
        variation.edits_base,
    )  # the simulation deformation is frozen where the base is edited
    if edits and isinstance(gaussians, FieldGaussians):
        return Visualization(variation, None)
    gaussians = gaussians.drawn()
    degree = max(color_degree, gaussians.color_degree)
    if edits:
        return Visualization(variation, _applied_functions(gaussians, variation, source), None, degree)
    wide = gaussians.with_color_degree(degree)
    deformation = BilinearDeformation.create(
        wide,
        len(source.catalog.plan.space) + len(variation.space),
        settings,
        color_columns=wide.colors.shape[1],
        for_visualization=True,
    )
    return Visualization(variation, deformation.to(gaussians.means.device), simulation.copy(), degree)


def _of_surfaces(
    lighting: Lighting, variation: Variation, source: Source, surfaces: EmulatedSurfaces | None
) -> Visualization:
    """A visualization deformation of lit surfaces, on Gaussians of its own."""
    settings = source.settings
    if surfaces is not None:
        own, deformation = surfaces.start(settings, source.normalization)
        return Visualization(variation, deformation, None, 0, own, lighting)
    own = source.gaussians_on_surfaces(variation)
    parameters = len(source.catalog.plan.space) + len(variation.space)
    deformation = BilinearDeformation.create(own, parameters, settings, for_visualization=True)
    return Visualization(variation, deformation, None, 0, own, lighting)


def _applied_functions(gaussians: Gaussians, variation: Variation, source: Source) -> ValuesDeformation:
    """A visualization deformation that applies transfer functions, from the base appearance and the field's histogram."""
    base = next(a for a in source.catalog.plan.appearances if a.name == variation.base)
    if not isinstance(base, VolumeRendering):
        raise ValueError(f"appearance {base.name} has no transfer function that could be varied")
    steps, function = [parameter.high for parameter in variation.space.parameters], base.transfer_function
    values = placed_values(VALUE_BINS, function.bounds, *source.histogram)
    return ValuesDeformation.create(gaussians, function, values, steps)


def in_common(visualization: Visualization, settings: TrainingSettings, data: TrainingData) -> Visualization:
    """A new one whose own Gaussians, where it has some, look as much like all members and settings as unmoved ones can."""
    if visualization.gaussians is None:
        return visualization
    own = replace(visualization.gaussians.copy(), lighting=visualization.lighting)
    steps = max(1, round(STILL * settings.visualization_steps))
    StageRun(replace(canonical_stage(own, settings), steps=steps), settings, data).finish()
    return replace(visualization, gaussians=replace(own.copy(), lighting=None))


def visualization_stage(
    gaussians: AnyGaussians,
    simulation: BilinearDeformation,
    visualization: Visualization,
    settings: TrainingSettings,
    *,
    begun: bool = False,
) -> Stage:
    """Optimize `visualization` in place: its deformation and, if any, its own Gaussians or copy of the simulation deformation.

    Gaussians of its own may have `begun` on emulated surfaces, and then learn slowly.
    """
    if visualization.gaussians is not None:
        stage = _surface_stage(gaussians, simulation, visualization, settings)
        factor = BEGUN_FACTOR if begun else 1.0
        return replace(stage, rates={name: factor * rate for name, rate in stage.rates.items()})
    of_vis, tuned = visualization.deformation, visualization.simulation
    if of_vis is None:
        return refinement_stage(gaussians, simulation, visualization, settings)
    parts = [("visualization.", of_vis, 1.0)]
    if tuned is not None:
        parts.append(("simulation.", tuned, SIMULATION_FACTOR))
    tensors = {prefix + name: t for prefix, part, _ in parts for name, t in part.tensors().items()}
    rates = {
        prefix + name: factor * rate for prefix, part, factor in parts for name, rate in part.rates(settings).items()
    }
    by_place: dict[tuple[float, ...], Gaussians] = {}

    def rest_at(parameters: Tensor) -> Gaussians:
        alone = parameters[: -len(visualization.variation.space)]  # [P]
        if tuned is not None:
            return visualization.simulated(gaussians, simulation, alone)
        place = tuple(alone.tolist())
        if place not in by_place:  # a member's Gaussians are always the same
            by_place[place] = visualization.simulated(gaussians, simulation, alone)
        return by_place[place]

    def gaussians_at(parameters: Tensor) -> Gaussians:
        if tuned is not None:
            return visualization.gaussians_at(gaussians, simulation, parameters)
        return of_vis.deformed(rest_at(parameters), parameters).drawn()

    return Stage(
        name=visualization.variation.kind,
        steps=settings.visualization_steps,
        tensors={name: tensor.requires_grad_() for name, tensor in tensors.items()},
        rates=rates,
        per_gaussian=frozenset(),
        carried_at=gaussians_at,
        shared=frozenset[str]().union(*(shared_of(part, prefix) for prefix, part, _ in parts)),
    )


def refinement_stage(
    gaussians: AnyGaussians, simulation: BilinearDeformation, visualization: Visualization, settings: TrainingSettings
) -> Stage:
    """Optimize `gaussians` that carry values, and their deformation, in place on pictures under all trained transfer functions."""
    assert isinstance(gaussians, FieldGaussians)
    before, base = simulation_stage(gaussians, simulation, settings), gaussians.field.base
    count = len(visualization.variation.space)
    return replace(
        before,
        name=visualization.variation.kind,
        steps=settings.visualization_steps,
        rates={name: REFINEMENT_FACTOR * rate for name, rate in before.rates.items()},
        warming=frozenset(),
        carried_at=lambda parameters: simulation.deformed(gaussians, parameters[:-count]),
        function_at=lambda parameters: visualization.function(base, parameters[-count:]),
    )


def _surface_stage(
    gaussians: AnyGaussians, simulation: BilinearDeformation, visualization: Visualization, settings: TrainingSettings
) -> Stage:
    """Optimize Gaussians of its own together with what moves them, as stage 2 does; dead ones are relocated."""
    assert visualization.gaussians is not None
    assert visualization.deformation is not None
    return replace(
        simulation_stage(visualization.gaussians, visualization.deformation, settings),
        warming=frozenset(),  # in the tutorial (one seed) surfaces that began slowly were 3.6 dB worse
        name=visualization.variation.kind,
        steps=settings.visualization_steps,
        carried_at=lambda parameters: visualization.gaussians_at(gaussians, simulation, parameters),
    )
