"""Accuracy over training time: a table and a plot over the scenes."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO

from catalogs.vocabulary.variations import KINDS
from research.benchmarks.results.parts import BASE
from research.benchmarks.results.scenes import SceneResults
from research.benchmarks.results.sources import made_from
from surrogate.evaluation.tables import NOTHING, table

PICTURE = "results_curves.png"
RESOLUTION = 130
TEXT = (
    "Each scene's catalog was trained by `surrogate train CATALOG --minutes`, which chooses the number of Gaussians and of steps.  "
    "It ran on one core, so a minute is one of processor time, with loading and all choices.  PSNR in dB is at unseen views of "
    "unseen members, in some rows under unseen isovalues or transfer functions.  In brackets is the number of Gaussians."
)


def curves_section(scenes: Sequence[SceneResults], is_drawn: bool) -> list[str]:
    """The section in Markdown; nothing where no scene was measured."""
    measured = [scene for scene in scenes if scene.curve]
    if not measured:
        return []
    minutes = sorted({point.minutes for scene in measured for point in scene.curve})
    rows = [row for scene in measured for row in _rows(scene, minutes)]
    return [
        "## What more time is worth",
        TEXT,
        table(("scene", *(f"{number:g} min" for number in minutes)), rows),
        f"![PSNR over processor seconds]({PICTURE})" if is_drawn else "",
        f"<sub>{'; '.join(map(_source, measured))}.</sub>",
    ]


def plot(scenes: Sequence[SceneResults]) -> bytes | None:
    """PSNR over processor seconds as PNG, a line for each scene and variation; None without measurements."""
    from matplotlib.figure import Figure

    lines = [
        (_name(scene, what), [(p.processor_seconds, p.unseen[what]) for p in scene.curve if what in p.unseen])
        for scene in scenes
        for what in _whats(scene)
    ]
    if not lines:
        return None
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    for name, points in lines:
        axes.plot(*zip(*points, strict=True), "o-", markersize=4, linewidth=1.3, label=name)
    axes.set_xscale("log")
    axes.set(xlabel="processor seconds of training", ylabel="PSNR at unseen views and parameters (dB)")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
    content = BytesIO()
    figure.savefig(content, format="png", dpi=RESOLUTION, facecolor="white")
    return content.getvalue()


def _whats(scene: SceneResults) -> list[str]:
    return list(dict.fromkeys(what for point in scene.curve for what in point.unseen))


def _name(scene: SceneResults, what: str) -> str:
    return scene.name + _words(what)


def _words(what: str) -> str:
    return "" if what == BASE else f", {KINDS[what].plural}"


def _rows(scene: SceneResults, minutes: Sequence[float]) -> list[list[str]]:
    at = {point.minutes: point for point in scene.curve}
    rows = []
    for what in _whats(scene):
        points = [at.get(number) for number in minutes]
        cells = [
            f"{point.unseen[what]:.2f} ({point.gaussians:,})" if point and what in point.unseen else NOTHING
            for point in points
        ]
        rows.append([f"`{scene.name}`{_words(what)}", *cells])
    return rows


def _source(scene: SceneResults) -> str:
    made = [{"commit": p.provenance.commit, "machine": p.provenance.machine} for p in scene.curve]
    seeds = sorted({point.seed for point in scene.curve})
    return f"`taskset -c 0 python -m research.benchmarks.training.curves scenes/{scene.name}.toml`: {made_from(made, seeds)}"
