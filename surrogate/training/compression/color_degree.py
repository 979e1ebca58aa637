"""The colour degree, chosen by images: does colour depend on the viewing direction?

Isosurfaces are lit, volumes usually are not: the base is asked during stage 2, every variation before its stage 3.
"""

from __future__ import annotations

from collections.abc import Sequence

from catalogs.vocabulary.variations import Variation
from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.loop import StageRun
from surrogate.training.source import Source
from surrogate.training.stages import RATES, Stage
from surrogate.training.state import FittedGaussians
from surrogate.training.visualizations import lighting_of, new_visualization, visualization_stage

NAME, VARIED_NAME = "colour degree", "varied colour degree"
ASKED_AFTER = 0.2  # of stage 2: places and shapes are good enough then to tell, and most time is still to be saved
SETTLING = 0.03  # of all steps, before the question: in a model that still moves, degree 1 makes up for other errors
PROBE = 0.02  # of all steps, for each degree
PROBE_OF_F_VIS = 0.05  # of stage 3, for each degree
WORTHWHILE = 0.05  # dB in so short a probe, more in the end: lit pictures (Nyx) gained 0.09, unlit volumes 0.01 at most


def choose_color_degree(fitted: FittedGaussians, evaluator: Evaluator) -> tuple[int, Choice]:
    """0 unless a linear dependence on the direction, with all else but colours held still, is seen in validation images.

    Both degrees are given the same short training of their colours, from `fitted` once that has settled; it has degree 0 and is
    not changed.
    """
    settled = evaluator.settled(fitted, evaluator.steps(SETTLING))
    return _decided(NAME, [_psnr_with_colors(settled, degree, evaluator) for degree in (0, 1)])


def choose_visualized_color_degree(
    fitted: FittedGaussians, variation: Variation, source: Source, evaluator: Evaluator
) -> tuple[int, Choice | None]:
    """0 unless a linear dependence on the direction is seen in validation images after a short stage 3 with each degree.

    The choice is None where the settings give the degree, or the base's colours depend on the direction already.  It is also None
    for transfer functions, for surfaces whose light is known, and without validation images.
    """
    degree, least = source.settings.visualization_color_degree, fitted.gaussians.color_degree
    if degree != "auto":
        return max(int(degree), least), None
    if lighting_of(variation, source) is not None:
        return 0, None
    if variation.edits_base or least == 1 or not evaluator.data.validation:
        return least, None
    return _decided(VARIED_NAME, [_psnr_of_variation(fitted, variation, source, evaluator, d) for d in (0, 1)])


def _decided(name: str, scores: Sequence[float]) -> tuple[int, Choice]:
    chosen = int(scores[1] > scores[0] + WORTHWHILE)
    return chosen, Choice(name, str(chosen), [Option(f"degree {d}", score) for d, score in enumerate(scores)])


def _psnr_with_colors(fitted: FittedGaussians, degree: int, evaluator: Evaluator) -> float:
    """Mean PSNR over the validation images once the colours, of this degree, have been trained."""
    gaussians = fitted.gaussians.drawn().copy().with_color_degree(degree)

    stage = Stage(
        name=NAME,
        steps=evaluator.steps(PROBE),
        tensors={"colors": gaussians.colors.requires_grad_()},
        rates={"colors": RATES["colors"]},
        per_gaussian=frozenset(),
        carried_at=lambda parameters: fitted.deformation.deformed(gaussians, parameters),
    )
    StageRun(stage, evaluator.settings, evaluator.data).finish()
    return evaluator.psnr_of(stage.gaussians_at)


def _psnr_of_variation(
    fitted: FittedGaussians, variation: Variation, source: Source, evaluator: Evaluator, degree: int
) -> float:
    """Mean PSNR over the validation images after a short stage 3 of its own."""
    steps = max(1, round(PROBE_OF_F_VIS * source.settings.visualization_steps))
    short = source.settings.changed(visualization_steps=steps)
    stage = visualization_stage(*fitted, new_visualization(*fitted, variation, source, degree), short)
    StageRun(stage, short, evaluator.data).finish()
    return evaluator.psnr_of(stage.gaussians_at)
