"""docs/results/volume_fidelity.md: the tables and the plot between its markers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from research.benchmarks.page import fill, page_in, table
from research.benchmarks.splatting.figures import COLORS, MARKERS, panels
from research.benchmarks.splatting.workloads import thousands
from research.benchmarks.training.fidelity.ensembles import ensembles_table
from research.benchmarks.training.fidelity.variants import BASE, FidelityVariant
from surrogate.provenance import in_words

PAGE, FIGURE = "volume_fidelity.md", "volume_fidelity.png"
Results = Mapping[str, Mapping[FidelityVariant, Mapping[str, Any]]]


def write(output: Path, results: Results, ensembles: list[dict[str, Any]], say: Callable[[str], None]) -> None:
    """Fill the page's parts with what there is; scenes without a base fit are left out."""
    results = {scene: records for scene, records in results.items() if any(v.group == BASE for v in records)}
    if not results:
        say("there are no results yet")
        return
    page = page_in(output, PAGE)
    first = next(iter(next(iter(results.values())).values()))
    made = (
        f"\n<sub>`python -m research.benchmarks.training.fidelity`, commit {first['commit']}, "
        f"{in_words(first['machine'])}, seed 0 where none is named.</sub>"
    )
    fill(page, "variants", variants_table(results) + made)
    fill(page, "rules", rules_table(results) + made)
    if ensembles:
        fill(page, "ensembles", ensembles_table(ensembles) + made)
    plot(output / FIGURE, results)
    say(str(page))


def variants_table(results: Results) -> str:
    """A row per variant; per scene its PSNR, and what it gains over the mean of the base's seeds."""
    every = list(dict.fromkeys(variant for records in results.values() for variant in records))
    header = ["", ""]
    for scene in results:
        header += [f"{scene}: validation, dB", "change", "test", "at half size"]
    rows = []
    for variant in every:
        row = ["**" + variant.group + "**" if _is_first(variant, every) else "", variant.name]
        for records in results.values():
            base = [r for v, r in records.items() if v.group == BASE]
            row += _cells(records.get(variant), base)
        rows.append(row)
    return table(header, rows)


def rules_table(results: Results) -> str:
    """Change of the same Gaussians' images by each rule, in dB, beside their error."""
    by_scene = {scene: _rules(records) for scene, records in results.items()}
    names = list(next(iter(by_scene.values())))
    label = {"error": "*the drawn picture against the volume's own*"}
    return table(
        ["", *(f"{scene}: PSNR between the two, dB" for scene in results)],
        [[label.get(name, name), *(f"{rules[name]:.1f}" for rules in by_scene.values())] for name in names],
    )


def plot(path: Path, results: Results) -> None:
    """Validation PSNR against the number of Gaussians and of steps."""
    shown = {"Gaussians": "gaussians", "steps": "canonical_steps"}
    with panels(path, len(shown), width=4.0, height=3.2) as axes:
        for axis, (group, setting) in zip(axes, shown.items(), strict=True):
            for (scene, records), color, marker in zip(results.items(), COLORS, MARKERS, strict=False):
                chosen = [r for v, r in records.items() if v.group == group or (v.group == BASE and v.name == "seed 0")]
                points = sorted({r["settings"][setting]: r["validation"] for r in chosen}.items())
                level = np.mean([r["validation"] for v, r in records.items() if v.group == BASE])
                x = [value for value, _ in points]
                axis.plot(
                    x, [y - level for _, y in points], f"{marker}-", color=color, markersize=4, linewidth=1, label=scene
                )
                axis.set_xscale("log")
                axis.xaxis.minorticks_off()
                axis.set_xticks(x, [thousands(value) for value in x], fontsize=7)
            axis.set(xlabel=group, ylabel="change of validation PSNR, dB")
        axes[0].legend()


def _cells(record: Mapping[str, Any] | None, base: list[Mapping[str, Any]]) -> list[str]:
    if record is None:
        return ["–"] * 4
    level = float(np.mean([r["validation"] for r in base]))
    return [
        f"{record['validation']:.2f}",
        f"{record['validation'] - level:+.2f}",
        f"{record['test']:.2f}",
        f"{record['half_size']:.2f}",
    ]


def _rules(records: Mapping[FidelityVariant, Mapping[str, Any]]) -> dict[str, float]:
    return next(dict(r["rules"]) for v, r in records.items() if v.group == BASE and "rules" in r)


def _is_first(variant: FidelityVariant, every: list[FidelityVariant]) -> bool:
    return next(v for v in every if v.group == variant.group) == variant
