"""docs/results/results.md: all tables, their sources and images."""

from __future__ import annotations

import re
from collections.abc import Container, Sequence
from pathlib import Path

from catalogs.files import durable
from research.benchmarks.results.ablations import study_section
from research.benchmarks.results.curves import PICTURE as CURVES
from research.benchmarks.results.curves import curves_section
from research.benchmarks.results.curves import plot as plot_curves
from research.benchmarks.results.functions import functions_section
from research.benchmarks.results.gaps import gaps_of, section_of
from research.benchmarks.results.parts import parts_of
from research.benchmarks.results.processors import processors_section
from research.benchmarks.results.quality import quality_tables
from research.benchmarks.results.scenes import SceneResults
from research.benchmarks.results.sources import report_sources, study_sources
from research.studies.ablation.table import plot
from research.wrapping import wrapped
from surrogate.evaluation.metrics import MOST_DECIBELS
from surrogate.evaluation.tables import NOTHING, document, number, plain_spread, table_of
from surrogate.report.report import RECORD
from surrogate.storage.records import read_json

PAGE = "results.md"
SOURCES = "What made these numbers"
PICTURE_LINK = re.compile(r"!\[[^\]]*\]\((results_[^/()]+\.png)\)")
INTRODUCTION = (
    "Every number on this page comes from the records in `research/records`. `make results` ends with "
    "`python -m research.benchmarks.results`, which writes the page and lists at its end the missing records and the commands "
    "for them.  Numbers are means over test images.  No choice was made on these images, but this page, the explorer's and "
    "others show them.  PSNR is of the full frame, on white or on the data's own background, by the definitions in every "
    "report.  Where there are several seeds, ± is their sample standard deviation.\n\n"
    "The per-member *upper bound* is the accuracy of as many Gaussians, fitted for as many steps to one unseen member (and "
    "setting) alone, at its unseen views.  In brackets is the surrogate on the same images.  The model's gap to its bound at "
    "*seen* parameters is underfitting; its loss from seen to unseen ones is prediction.\n\n"
    "*The same model at the centre of the parameters*, of the scene's own seed, is frozen there for every member.  If it is as "
    "good, the parameters hardly matter.\n\n"
    "*Trivial predictors* mix stored images at the very same view, which the surrogate never sees and which need not exist.  "
    "Those of settings mix images of the same member under its trained settings.  An image counts at most "
    f"{MOST_DECIBELS:.0f} dB, which some of theirs reach."
)
COST_COLUMNS = (  # times are of the scene's own seed
    ("scene", lambda scene: f"`{scene.name}`"),
    ("Gaussians", lambda scene: _size(scene, "gaussians", scene.report["gaussians"], 0)),
    ("model (MB)", lambda scene: _size(scene, "megabytes", scene.report["model_megabytes"], 2)),
    ("making the data set (s)", lambda scene: number(scene.report["seconds"]["dataset"], 0)),
    ("training (s)", lambda scene: _size(scene, "seconds", scene.report["seconds"]["train"], 0)),
    (
        "of all cores together (s)",
        lambda scene: _size(scene, "processor_seconds", scene.report["seconds"].get("train_processor"), 0),
    ),
    ("a picture (ms)", lambda scene: number(scene.report["milliseconds"]["view_change"])),
    ("a parameter change (ms)", lambda scene: number(scene.report["milliseconds"]["parameter_change"])),
    (
        "a change of the isovalue, transfer function or field (ms)",
        lambda scene: (
            ", ".join(number(v["milliseconds"]["visualization_change"]) for v in scene.report["variations"]) or NOTHING
        ),
    ),
    ("seeds", lambda scene: str(len(scene.repeats["seeds"])) if scene.repeats else "1"),
)


def page(scenes: Sequence[SceneResults], pictures: Container[str]) -> str:
    """The page; `pictures` are the names of the images beside it."""
    reported = [scene for scene in scenes if scene.report is not None]
    return document(
        "# Results",
        INTRODUCTION,
        _earlier([scene.name for scene in scenes if scene.earlier]),
        *(block for one in quality_tables(parts_of(scenes)) for block in (f"## {one.title}", one.text, one.table)),
        *functions_section(scenes),
        "## How large, how fast",
        "Times are medians, one picture at a time.",
        table_of(reported, *COST_COLUMNS) if reported else "No scene has a report yet.",
        *curves_section(scenes, CURVES in pictures),
        *processors_section(scenes),
        *([f"## {SOURCES}", report_sources(scenes)] if reported else []),
        *_pictures(scenes, pictures),
        "## What each choice of training is worth",
        *(_ablations(scenes, pictures) or ["No scene has an ablation yet."]),
        *section_of([gap for scene in scenes for gap in gaps_of(scene)]),
    )


def pictures_of(scenes: Sequence[SceneResults], output: Path) -> dict[str, bytes]:
    """The images of the page by name: of a scene's variations or its comparison, of its ablations, and of all curves.

    Those of reports come from runs/, where these are the reports that are shown; else what lies in `output` stays.
    """
    images: dict[str, bytes | None] = {}
    for scene in scenes:
        folder = scene.run / "report"
        same = scene.report and (read_json(folder / RECORD) or {}).get("fingerprint") == scene.report["fingerprint"]
        new = {_picture(scene, sheet): _content(folder / sheet) if same else None for sheet in _sheets(scene)}
        new |= {_picture(scene, f"{study.kind.folder}.png"): plot(study.rows) for study in scene.studies}
        images |= {name: content or _content(output / name) for name, content in new.items()}
    images[CURVES] = plot_curves(scenes)
    return {name: content for name, content in images.items() if content is not None}


def write(output: Path, scenes: Sequence[SceneResults]) -> Path:
    """Write the page and its images into the folder `output`, each atomically; images of an earlier page are removed."""
    pictures, earlier = pictures_of(scenes, output), _pictures_on(output / PAGE)
    durable.make_folder(output)
    for name, content in pictures.items():
        durable.replace(output / name, content)
    durable.replace(output / PAGE, wrapped(page(scenes, pictures)).encode())
    for name in earlier - set(pictures):
        (output / name).unlink(missing_ok=True)
    return output / PAGE


def _content(path: Path) -> bytes | None:
    return path.read_bytes() if path.is_file() else None


def _picture(scene: SceneResults, name: str) -> str:
    return f"results_{scene.name}_{name}"


def _pictures_on(path: Path) -> set[str]:
    """Names of the image copies on a page; empty without a page."""
    return set(PICTURE_LINK.findall(path.read_text(encoding="utf-8", errors="replace"))) if path.is_file() else set()


def _size(scene: SceneResults, name: str, alone: float | None, digits: int) -> str:
    """The mean over several seeds, otherwise the report's value."""
    if scene.repeats:
        spread = scene.repeats.get(name)
        return plain_spread(spread, digits) if spread else NOTHING
    return NOTHING if alone is None else f"{alone:,.{digits}f}"


def _sheets(scene: SceneResults) -> list[str]:
    if scene.report is None:
        return []
    return [f"{varied['kind']}.png" for varied in scene.report["variations"]] or ["comparison.png"]


def _pictures(scenes: Sequence[SceneResults], pictures: Container[str]) -> list[str]:
    blocks = [
        f"`{scene.name}`: {scene.title}\n\n![{scene.name}]({name})"
        for scene in scenes
        for name in (_picture(scene, sheet) for sheet in _sheets(scene))
        if name in pictures
    ]
    return ["## Truth, prediction and difference", *blocks] if blocks else []


def _ablations(scenes: Sequence[SceneResults], pictures: Container[str]) -> list[str]:
    blocks = []
    for scene in scenes:
        for study in scene.studies:
            name = _picture(scene, f"{study.kind.folder}.png")
            blocks += [f"### `{scene.name}`, {study.kind.title}", *study_section(study)]
            blocks += [f"![{scene.name}]({name})" if name in pictures else "", study_sources(scene.name, study)]
    return blocks


def _earlier(names: Sequence[str]) -> str:
    """Of which scenes something was not measured by the present code."""
    return (
        "The code that trains and evaluates, or its settings, have changed since some measurements of "
        f"{', '.join(f'`{name}`' for name in names)}. These figures are of the commits listed under *{SOURCES}*."
        if names
        else ""
    )
