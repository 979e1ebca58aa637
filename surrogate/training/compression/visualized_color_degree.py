"""Whether the Gaussians that F_vis shows need colours that depend on the direction: isosurfaces are lit, the volume is not."""

from __future__ import annotations

from catalogs.variations import Variation
from surrogate.evaluation.metrics import WHITE
from surrogate.rasterizer import Rasterizer
from surrogate.training.compression.choice import Choice, Option
from surrogate.training.compression.fitted import Fitted
from surrogate.training.data import TrainingData
from surrogate.training.loop import StageRun
from surrogate.training.source import Source
from surrogate.training.validation import mean_psnr
from surrogate.training.visualizations import new_visualization, visualization_stage

NAME = "colour degree of F_vis"
PROBE = 0.05  # of stage 3, for each degree
WORTHWHILE = 0.05  # dB


def choose_visualized_color_degree(
    fitted: Fitted, variation: Variation, source: Source, data: TrainingData
) -> tuple[int, Choice | None]:
    """0 unless a linear dependence on the direction is seen in validation images after a short training with each degree.

    Nothing is asked, and the choice None, where the settings say it, where transfer functions are varied (they do not light),
    where the base's colours depend on the direction already, or without validation images.
    """
    asked, least = source.settings.designs.visualization_color_degree, fitted.gaussians.color_degree
    if asked != "auto":
        return max(int(asked), least), None
    if variation.edits_base or least == 1 or not data.validation:
        return least, None
    scores = [_probed(fitted, variation, source, data, degree) for degree in (0, 1)]
    chosen = int(scores[1] > scores[0] + WORTHWHILE)
    return chosen, Choice(NAME, str(chosen), [Option(f"degree {d}", score) for d, score in enumerate(scores)])


def _probed(fitted: Fitted, variation: Variation, source: Source, data: TrainingData, degree: int) -> float:
    """Mean PSNR over the validation images after a short stage 3 of its own."""
    settings = source.settings
    steps = max(1, round(PROBE * settings.steps.visualization))
    short = settings.changed(visualization_steps=steps)
    visualization = new_visualization(*fitted, variation, source, degree)
    stage = visualization_stage(*fitted, visualization, short)
    run = StageRun(stage, short, data)
    while run.step < steps:
        run.advance()
    return mean_psnr(stage.gaussians_at, data.validation, Rasterizer.of(short), data.background or WHITE)
