"""Training time against PSNR: each budget is a whole schedule that fits into it, not a longer run cut short."""

from __future__ import annotations

from benchmarks.page import table
from benchmarks.splatting.figures import COLORS, MARKERS, panels, plain_ticks
from benchmarks.splatting.setup import Setup
from benchmarks.splatting.trained import Trained, mean_decibels

FIGURE = "splatting_training.png"
JUDGED = 96  # validation images for the final number; the curve looks at those that the settings say


def training_time(setup: Setup, trained: Trained) -> str:
    """A row per budget, and the plot of all curves."""
    rows, fits = [], []
    for budget in trained.budgets:
        fits.append(trained.fit(budget))
        surrogate = fits[-1].surrogate
        judged = trained.validation(JUDGED)
        curve, settings = fits[-1].curve, surrogate.training["settings"]
        rows.append(
            [
                f"{budget:.0f}",
                f"{surrogate.training['seconds']:.1f}",
                f"{settings['canonical_steps']} + {settings['deformation_steps']}",
                f"{len(surrogate.gaussians):,}",
                f"{surrogate.megabytes:.2f}",
                f"{curve[-1][1]:.2f}",
                f"{mean_decibels(surrogate, trained, judged):.2f}",
            ]
        )
    with panels(setup.output / FIGURE, height=3.6) as axes:
        for fit, color, marker in zip(fits, COLORS, MARKERS, strict=False):
            seconds, decibels = zip(*fit.curve, strict=True)
            axes.plot(seconds, decibels, "-", color=color, linewidth=1.2, label=f"schedule of {fit.budget:.0f} s")
            axes.plot(seconds[-1], decibels[-1], marker, color=color, markersize=6)
        axes.set(xscale="log", xlabel="seconds of training, data loading included", ylabel="validation PSNR, dB")
        plain_ticks(axes.xaxis)
        axes.set_title(f"{trained.name}, seed {trained.settings.seed}")
        axes.legend(loc="lower right")
    header = ["budget, s", "taken, s", "steps", "Gaussians", "MB", "validation PSNR at the end of its curve, dB"]
    described = (
        f"Scene {trained.name}, seed {trained.settings.seed}, other settings as in scenes/{trained.name}.toml. A budget counts the "
        "time of all cores together (on a GPU that on the wall), what was taken the time on the wall.\n\n"
    )
    return described + table([*header, f"of {len(trained.validation(JUDGED))} validation images, dB"], rows)
