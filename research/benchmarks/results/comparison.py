"""The page of the comparison with published systems, from the records of `python -m research.studies compare`.

    python -m research.benchmarks.results.comparison [SCENE...] [--records research/records]

Writes docs/results/comparison.md and its plots for the named scenes, by default all that have records.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from catalogs.files import durable
from research.benchmarks.page import PROJECT, RESULTS, command_line
from research.benchmarks.results import paper
from research.benchmarks.results.gaps import section_of
from research.benchmarks.results.protocol import gaps
from research.studies.comparison import tuning
from research.studies.comparison.methods import CONTESTANTS, MADE_FOR, title
from research.studies.comparison.page import SHORT_HEADER, in_short, tables
from research.studies.comparison.plots import curves, sheet, without_pictures
from research.studies.comparison.result import AS_PUBLISHED, FOLDER, TRIVIAL, ComparisonResult, Terms, load, terms
from research.wrapping import wrapped
from surrogate.evaluation.tables import NOTHING, document, number, table
from surrogate.provenance import in_words

PAGE = "comparison.md"
TEXT = """\
Every method learns from the same images, members and views, over the same background. All are scored by the same test images
(24 in each cell, drawn once) and the same metrics. Bold is the best of a cell, whichever method that is."""
TERMS = """\
- **Equal time** is processor time on one core, from the loading of the images to the last step. Looks at validation images for
  the curves are not counted, nor are the frozen Gaussians that GS-Surrogate and 4DGS-HD start from, nor measurements of the
  time of published methods' steps. A training that misses its time by 15 % is repeated with as many steps as fit. Earlier ones
  were not: ViSNeRF took longer on `euler`, `ocean` and, with one seed, `cloverleaf`; the tables have its seconds.
  GS-Surrogate, light, took 215 to 350 s of its 300 on `tgv`, `cloverleaf` and `nyx`, and 1,142 s of its 1,800 on `cloverleaf`.
  This surrogate took 348 s of its 300 on `cloverleaf-large`.
- **Four processor hours** are those of two threads together, by 4DGS-HD and ViSNeRF on `cloverleaf` alone. ViSNeRF took 16,159 s
  of its 14,400 for 16,381 steps, which were set by hand.
- **Where isovalues or transfer functions vary**, this surrogate first learns the base appearance in the same time, as did
  GS-Surrogate, light. No cell shows that, and their curves begin after it. Published methods learn everything together. A curve
  is missing where it was recorded on the wall's clock.
- **Networks of its own for functions and isosurfaces.** GS-Surrogate's newer code has two networks, which have rows beside the
  paper's field. That for functions first learns the base in 80,000 of its 180,000 published steps, then freezes it; opacities
  and colours alone follow the function. It learns each function from a fifth of the members, two of ten, where all others learn
  from three. That for isosurfaces has 150,000 published steps instead of 80,000. On `tgv-tf` the first learnt
  from images that today's renderer made again, and is judged by those.
- **Starved** is a method that made a few per cent of its published steps (*of the published*). Its row shows what it reaches
  in that time on a processor, not what it can do on a GPU. Every schedule is stretched or compressed to the steps that fit.
- **Sizes.** Images with more than 128 pixels a side are averaged down to that; they are too small for MS-SSIM. InSituNet,
  K-Planes and ViSNeRF are smaller than published. GS-Surrogate and InSituNet train in bfloat16 where the processor multiplies in
  it, else in float32 with fewer steps. Each has its own row.
- **Samples.** Images of isosurfaces are means over their pixels. This surrogate, and GS-Surrogate, light, draw them, and those of
  `nyx`, with four samples a pixel, within their time. Published methods draw one, as published.
- **Machines** were of several kinds. If those of a scene differ, its last lines name the machine of each training.
- **Images side by side** are of seed 0. Some are of a repeated training with the steps, rate and seed of its record, by a script
  outside this repository. They are within 0.14 dB, except that InSituNet in `nyx` was 0.5 dB better after five minutes.
- **Rates** of published methods are multiplied by the factor that did best in five trainings of a minute, at validation images.
  Their scene is `cloverleaf`, or the only one that a network is made for. Ours are not tuned.
  The factor may not be the best elsewhere.
  At its published rates ViSNeRF reaches 22.1 dB in the last cell of `nyx` after five minutes, at the chosen ones 18.9.
  After thirty it reaches 27.0 (4,630 steps), at the chosen ones 23.6 (3,994). 4DGS-HD at its published rates reaches 32.6 dB in
  the last cell of `tgv` after thirty minutes (8,709 steps), at the chosen 0.3 of them 31.5 (7,154). Those of thirty minutes ran
  on another machine, which made more steps. In both scenes another published method stays the best one. (`python -m
  research.studies compare scenes/SCENE.toml --methods NAME --minutes M` with an empty folder of `--records`; those of thirty
  minutes: commit `f0395b618d62`, AMD EPYC (avx512), 1 core, seed 0.)
- **Divergence.** If a longer training diverges at its rates, it is repeated at the next lower ones. Of two half hours of
  K-Planes on `cloverleaf` at the same rates one diverged (commit `c6130f237be2`); the table has the other.
- **Stored images, mixed** are the best of the trivial predictors. They need a stored image at the very view, so they have none
  of novel views.

The head of each file in `research/studies/baselines` names the paper or code that a method was written from, and the
differences."""
IN_SHORT = "PSNR (dB), means over seeds; the sections below have all metrics, methods, sizes and times."
PUBLISHED = """\
Equal time on a processor says nothing about what a method can do.
`python -m research.studies compare scenes/SCENE.toml --published --device cuda --stop-after 9` trains all methods at their
published sizes and numbers of steps, ours for as many steps as GS-Surrogate. It works in pieces of nine minutes, with a
checkpoint between them."""
NO_PICTURES = "No pictures were kept of: {}."
MISSING = "Each takes its time on a core."
NOT_RUN = (
    "It has not been run yet: there was no GPU. Its tables will join those of each scene; this one is empty until then."
)


def page(records: Path, scenes: Sequence[str], drawn: Iterable[str]) -> str:
    """The page in Markdown, with the plots in `drawn`."""
    names, results = set(drawn), {scene: load(records / scene) for scene in scenes}
    return document(
        "# Beside published systems",
        TEXT,
        *_in_short(results),
        "## On which terms",
        TERMS,
        "## Methods",
        table(("method", "published in", "steps there"), _who()),
        *(part for scene in scenes for part in _section(records / scene, results[scene], names)),
        *_published([result for of in results.values() for result in of]),
        paper.section(),
        *_tuned(tuning.load(records)),
        *section_of(gaps(results), MISSING),
    )


def plots(records: Path, scene: str) -> dict[str, bytes]:
    """Plots of a scene's results as PNG, by name."""
    results = load(records / scene)
    files = {f"comparison_{scene}_curves.png": curves(results)}
    for each in terms(results):
        files[f"comparison_{scene}_{each.name}.png"] = sheet(records / scene, results, each)
    return {name: content for name, content in files.items() if content is not None}


def main() -> None:
    """Write the page and its plots."""
    parser = command_line("results.comparison", __doc__)
    parser.add_argument("scenes", nargs="*", metavar="SCENE")
    parser.add_argument("--records", type=Path, default=PROJECT / "research" / "records")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    given = parser.parse_args()
    available = sorted(path.parent.name for path in given.records.glob(f"*/{FOLDER}") if load(path.parent))
    missing = sorted(set(given.scenes) - set(available))
    if missing or not available:
        parser.error(
            f"no records of {', '.join(missing) or 'any scene'} in {given.records}: `python -m research.studies compare` makes them"
        )
    scenes = given.scenes or available
    drawn = {name: content for scene in scenes for name, content in plots(given.records, scene).items()}
    for name, content in drawn.items():
        durable.replace(given.output / name, content)
    durable.replace(given.output / PAGE, wrapped(page(given.records, scenes, drawn)).encode())
    print(given.output / PAGE)


def _in_short(results: Mapping[str, Sequence[ComparisonResult]]) -> list[str]:
    rows = [row for scene, of in results.items() for row in in_short(scene, of)]
    return ["## In short", IN_SHORT, table(SHORT_HEADER, rows)] if rows else []


def _who() -> list[list[str]]:
    rows = []
    for contestant in CONTESTANTS.values():
        steps = f"{contestant.official_steps:,}" if contestant.official_steps else NOTHING
        rows.append([contestant.title, contestant.source, steps])
    return rows


def _section(records: Path, results: Sequence[ComparisonResult], drawn: set[str]) -> list[str]:
    scene = records.name
    plot = f"comparison_{scene}_curves.png"
    return [
        f"## `{scene}`",
        tables(results),
        f"![PSNR of validation images over processor seconds]({plot})" if plot in drawn else "",
        *(part for each in terms(results) for part in _sheet(records, results, each, drawn)),
        f"<sub>`python -m research.studies compare scenes/{scene}.toml`; {_made(results)}.</sub>",
    ]


def _sheet(records: Path, results: Sequence[ComparisonResult], on: Terms, drawn: set[str]) -> list[str]:
    """A sheet, and the methods that it lacks."""
    name = f"comparison_{records.name}_{on.name}.png"
    if name not in drawn:
        return []
    absent = "; ".join(title(row).strip("*") for row in without_pictures(records, results, on))
    return [f"![Test images after {on}]({name})", f"<sub>{on}. {NO_PICTURES.format(absent)}</sub>" if absent else ""]


def _published(results: Sequence[ComparisonResult]) -> list[str]:
    """Instructions for published sizes and steps, with an empty table before any such training."""
    blocks = ["## Sizes and steps as published", PUBLISHED.replace("\n", " ")]
    if any(each.minutes == AS_PUBLISHED for each in terms(results)):
        return blocks
    methods = [c for c in CONTESTANTS.values() if (c.official_steps or c.steps_of) and c.name not in MADE_FOR]
    steps = [CONTESTANTS[c.steps_of].official_steps if c.steps_of else c.official_steps for c in methods]
    rows = [[c.title, f"{count:,}", NOTHING, NOTHING, NOTHING] for c, count in zip(methods, steps, strict=True)]
    return [*blocks, NOT_RUN, table(("method", "steps", "novel views", "unseen parameters", "both"), rows)]


def _made(results: Sequence[ComparisonResult]) -> str:
    """Machines and commits; for several machines also the methods trained on each."""
    methods: dict[str, dict[str, None]] = {}
    for result in (r for r in results if r.method != TRIVIAL):
        methods.setdefault(in_words(result.provenance.machine), {})[title(result.row).strip("*")] = None
    commits = ", ".join(dict.fromkeys(f"`{r.provenance.commit}`" for r in results))
    if len(methods) < 2:
        return f"{''.join(methods)}; commit {commits}"
    return ". ".join([f"commit {commits}", *(f"{machine}: {'; '.join(titles)}" for machine, titles in methods.items())])


def _tuned(tunings: Sequence[tuning.Tuning]) -> list[str]:
    if not tunings:
        return []
    header = ("method", "scene", "size", "precision", *(f"{rate:g}" for rate in tuning.RATES))
    rows = [
        [
            CONTESTANTS[t.method].title,
            f"`{t.scene}`",
            t.size,
            t.precision,
            *(number(t.decibels.get(f"{rate:g}")) for rate in tuning.RATES),
        ]
        for t in tunings
        if t.method in CONTESTANTS
    ]
    note = (
        "PSNR (dB) of the scene's validation images after a minute, by what the published rates are multiplied by; "
        f"{NOTHING} where it diverged."
    )
    return ["## Rates", note, table(header, rows)]


if __name__ == "__main__":
    main()
