"""docs/results.md: all tables, each with what made it, and the pictures that belong to them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.results.ablations import study_lines
from benchmarks.results.cost import cost_table
from benchmarks.results.parts import parts_of
from benchmarks.results.quality import QualityTable, quality_tables
from benchmarks.results.scenes import Gap, SceneResults
from benchmarks.results.sources import report_sources, study_sources
from catalogs import durable
from surrogate.evaluation.tables import table
from surrogate.studies.ablation.table import PICTURE

PAGE = "results.md"
PICTURE_LINK = re.compile(r"!\[[^\]]*\]\((results_[^/()]+\.png)\)")
INTRODUCTION = (
    "Every number on this page was read from `runs/` by `python -m benchmarks.results`, which `make results` ends with; what is "
    "missing stands at the end, with the command that makes it.  Means over test images, which no choice was made on; PSNR of the "
    "full frame, on white or on the data's own background, by the definitions that stand in every report.  Where there are several "
    "seeds, ± is their sample standard deviation.  A *ceiling* is what as many Gaussians reach that are fitted, for as many "
    "steps, to one unseen member (and setting) alone, at its unseen views; in brackets the surrogate on the same images.  "
    "*Trivial predictors* mix stored pictures at the very same view: ones that the surrogate is not given and that need not exist; "
    "those of settings are on the images that they can predict."
)


def page(scenes: Sequence[SceneResults], pictures: Mapping[Path, str]) -> str:
    """The page; `pictures` says under which name each picture of runs/ lies beside it."""
    shown = {scene.name: scene for scene in scenes}
    lines = ["# Results", "", INTRODUCTION, ""]
    for quality in quality_tables(parts_of(scenes)):
        lines += _quality_section(quality, [shown[name] for name in quality.scenes])
    lines += ["## How large, how fast", "", "Times are medians, one picture at a time.", "", *cost_table(scenes), ""]
    lines += [report_sources(scenes), "", *_pictures_section(scenes, pictures), *_ablation_sections(scenes, pictures)]
    return "\n".join([*lines, *_gaps_section([gap for scene in scenes for gap in scene.gaps])])


def pictures_of(scenes: Sequence[SceneResults]) -> dict[Path, str]:
    """The pictures that belong on the page, and their names there: of a scene's variations, or else its comparison."""
    found = {}
    for scene in scenes:
        for name in _sheets(scene):
            found[scene.run / "report" / name] = f"results_{scene.name}_{name}"
        for study in scene.studies:
            found[study.folder / PICTURE] = f"results_{scene.name}_{study.kind.folder}.png"
    return {path: name for path, name in found.items() if path.is_file()}


def write(output: Path, scenes: Sequence[SceneResults]) -> Path:
    """Write the page and copies of its pictures into the folder `output`, each whole; pictures of an earlier page that are
    no longer shown are removed."""
    pictures, earlier = pictures_of(scenes), _pictures_on(output / PAGE)
    durable.make_folder(output)
    for path, name in pictures.items():
        durable.replace(output / name, path.read_bytes())
    durable.replace(output / PAGE, page(scenes, pictures).encode())
    for name in earlier - set(pictures.values()):
        (output / name).unlink(missing_ok=True)
    return output / PAGE


def _pictures_on(path: Path) -> set[str]:
    """Names of the copies that a page shows; none without one."""
    return set(PICTURE_LINK.findall(path.read_text(encoding="utf-8", errors="replace"))) if path.is_file() else set()


def _quality_section(quality: QualityTable, scenes: Sequence[SceneResults]) -> list[str]:
    return [f"## {quality.title}", "", quality.text, "", *quality.lines, "", *_if_any(report_sources(scenes))]


def _sheets(scene: SceneResults) -> list[str]:
    if scene.report is None:
        return []
    return [f"{varied['kind']}.png" for varied in scene.report["variations"]] or ["comparison.png"]


def _pictures_section(scenes: Sequence[SceneResults], pictures: Mapping[Path, str]) -> list[str]:
    lines = []
    for scene in scenes:
        names = [pictures[path] for sheet in _sheets(scene) if (path := scene.run / "report" / sheet) in pictures]
        lines += [
            text for name in names for text in (f"`{scene.name}`: {scene.title}", "", f"![{scene.name}]({name})", "")
        ]
    return ["## Truth, prediction and difference", "", *lines] if lines else []


def _ablation_sections(scenes: Sequence[SceneResults], pictures: Mapping[Path, str]) -> list[str]:
    lines = ["## What each choice of training is worth", ""]
    for scene in scenes:
        for study in scene.studies:
            name = pictures.get(study.folder / PICTURE)
            picture = [] if name is None else [f"![{scene.name}]({name})", ""]
            lines += [f"### `{scene.name}`, {study.kind.title}", "", *study_lines(study), *picture]
            lines += [study_sources(scene.name, study), ""]
    return lines if len(lines) > 2 else [*lines, "No scene has an ablation yet.", ""]


def _gaps_section(gaps: Sequence[Gap]) -> list[str]:
    if not gaps:
        return []
    rows = [(f"`{gap.scene}`", gap.what, f"`{gap.command}`") for gap in gaps]
    return ["## What is missing", "", *table(("scene", "what", "made by"), rows), ""]


def _if_any(text: str) -> list[str]:
    return [text, ""] if text else []
