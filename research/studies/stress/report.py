"""The results of the hard cases as a page and an image."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np

from catalogs.files import durable
from research.studies.stress.cases import BitwiseCase, Refusal, StressCase
from research.studies.stress.check import MARGIN, CaseOutcome
from research.studies.stress.drift import MOST_DECIBELS, MOST_TIMES, Drift
from research.studies.stress.functions import FunctionCase, FunctionOutcome
from research.wrapping import wrapped
from surrogate.appearance.averages import LEAST_SPREAD, NEGLIGIBLE, TOLERANCE
from surrogate.evaluation.tables import document, table_of
from surrogate.provenance import commit, in_words, machine

PAGE, PICTURE = "stress.md", "stress.png"
COLUMNS = 9
INTRODUCTION = """# Hard cases

Each row below is an extreme scene. It is drawn and differentiated in float32 by {backends}, and by the float64
reference implementation (`surrogate/splatting/reference.py`), which defines the right result. Every row has bounds of its own;
`python -m research.studies stress` ends with an error if one is missed. Nothing is repaired before the comparison: a NaN
anywhere is a miss.

**{verdict}** `python -m research.studies stress`, commit {commit}, {where}, {system}. Scenes are drawn by fixed seeds."""
DRAWN = """![The hard cases as they are drawn]({picture})

## Drawing

*Image* is the largest error of colour (relative to the largest colour where that is above 1), alpha and depth (relative to the
largest), over all pixels and backends. *Gradient* is the largest error by any attribute,
relative to the largest gradient of its kind, for a random functional of the image. Drawing has two thresholds, the alpha floor
and the least transmittance. Where a contribution lies within {margin:g} of one (relative), float32 may rightly fall to its other
side. Such pixels are *uncertain*: the table has their share, and the largest *jump* in them, but the bounds hold in all others."""
AGREEMENTS = """## Bitwise equality

Image and gradients of 3,000 Gaussians, of which every other lies exactly where the one before it does (ties are drawn in the
order of their index):"""
REFUSALS = """## Refusals

The error names the attribute and the Gaussian, and nothing is drawn:"""
FUNCTIONS = """## Transfer functions and field values

Gaussians with field values, and spreads of these, are drawn by the transfer function's extinction and emission, averaged over the
values. *Average* is the largest error of the averages by the averaged extinction (at least {least:g} of the largest), against
quadrature in float64; its bound is {tolerance:.0e}. *Shown* is that of opacity and opacity times colour in float32, against the
float64 reference implementation (`surrogate/appearance/transferred.py`). *Gradient* is that of a random functional of both by
thickness, value and spread, of all Gaussians that are drawn. The kernel interpolates a table of averages, whose slopes err more
than its values. A constant field has no spread; spreads below {spread:g} of the function's range count as that."""
DRIFT = """## Drift of training

The same small ensemble (60 Gaussians with their bilinear deformation, 32 x 32 pixels) is trained three times on the same images
in the same order. The first training is in float64 by the definitions in plain torch, the second in float32 by the kernels. The
third is in float64 from a start that is rounded differently in the last place of float32. Training amplifies any difference, so
the third shows how far apart two correct runs end. Float32 must end within {decibels:g} dB and within {times:g} times that
distance."""
LIMITS = """## Limits

- Thresholds make an image a discontinuous function of the Gaussians. A contribution that crosses the alpha floor (1/255) changes
  a pixel by as much, which gradients do not include.
- Gaussians are sorted by their centres and do not interpenetrate ([what that costs](volume_fidelity.md)).
- Without dilation, a Gaussian thinner than a pixel may fall between all pixel centres: it is not drawn then, and has no gradient.
- World coordinates around 10⁶ cannot be represented in float32 to better than 0.06. `Surrogate` and training subtract the
  scene's origin in float64 first; other callers of `surrogate.splatting.render` must do so too.
- More than 2³² touched tiles (of 20,000 Gaussians each would have to cover 200,000) are refused, and so are scenes that exceed
  the memory."""


def write(
    folder: Path,
    tables: Mapping[str, Sequence[CaseOutcome]],
    drift: Drift | None,
    functions: Sequence[FunctionOutcome] = (),
) -> None:
    """Write `stress.md` and `stress.png` into `folder`; `tables` holds the outcomes by backend."""
    folder.mkdir(parents=True, exist_ok=True)
    first = next(iter(tables.values()))
    durable.replace(folder / PICTURE, _picture([o for o in first if o.pictures is not None]))
    durable.replace(folder / PAGE, wrapped(_page(tables, drift, functions)).encode())


def _page(
    tables: Mapping[str, Sequence[CaseOutcome]], drift: Drift | None, functions: Sequence[FunctionOutcome]
) -> str:
    rows = list(zip(*tables.values(), strict=True))  # a row holds an outcome of each backend
    drawn = [row for row in rows if isinstance(row[0].case, StressCase)]
    every: list[tuple[str, CaseOutcome | FunctionOutcome]] = [(name, o) for name, of in tables.items() for o in of]
    every += [("values", o) for o in functions]
    missed, on = [(name, o) for name, o in every if not o.passed], machine()
    verdict = f"{len(missed)} cases fail." if missed else "All cases pass."
    return document(
        INTRODUCTION.format(
            backends=", ".join(tables), verdict=verdict, commit=commit(), where=in_words(on), system=on["system"]
        ),
        "\n".join(f"- failed: {o.case.name} ({name}): {'; '.join(o.complaints)}" for name, o in missed),
        DRAWN.format(picture=PICTURE, margin=MARGIN),
        table_of(
            drawn,
            ("", lambda row: row[0].case.name),
            ("image, bound", lambda row: f"{row[0].case.image:.0e}"),
            ("image, found", lambda row: _error(o.image for o in row)),
            ("gradient, bound", lambda row: f"{row[0].case.gradient:.0e}"),
            ("gradient, found", lambda row: _error(error for o in row for error in o.gradients.values())),
            ("finite", lambda row: "yes" if all(o.finite for o in row) else "**no**"),
            ("uncertain", lambda row: f"{100 * max(o.uncertain for o in row):.2g} %"),
            ("jump", lambda row: _error(o.jump for o in row)),
        ),
        "Where bounds differ from the usual ones:",
        _reasons([row[0].case for row in drawn]),
        AGREEMENTS,
        _verdicts("bit for bit the same", [row for row in rows if isinstance(row[0].case, BitwiseCase)]),
        REFUSALS,
        _verdicts("refused by name", [row for row in rows if isinstance(row[0].case, Refusal)]),
        *_function_blocks(functions),
        *([] if drift is None else _drift_blocks(drift)),
        LIMITS,
    )


def _function_blocks(functions: Sequence[FunctionOutcome]) -> list[str]:
    if not functions:
        return []
    shown = table_of(
        functions,
        ("", lambda o: o.case.name),
        ("average, found", lambda o: _error([o.average])),
        ("shown, bound", lambda o: f"{o.case.shown:.0e}"),
        ("shown, found", lambda o: _error([o.shown])),
        ("gradient, bound", lambda o: f"{o.case.gradient:.0e}"),
        ("gradient, found", lambda o: _error([o.gradient])),
        ("finite", lambda o: "yes" if o.finite else "**no**"),
    )
    said = FUNCTIONS.format(least=NEGLIGIBLE, tolerance=TOLERANCE, spread=LEAST_SPREAD)
    return [said, shown, "Where bounds differ from the usual ones:", _reasons([o.case for o in functions])]


def _reasons(cases: Sequence[StressCase | FunctionCase]) -> str:
    reasons = dict.fromkeys(case.why for case in cases if case.why)
    rows = [(why, "; ".join(case.name for case in cases if case.why == why)) for why in reasons]
    return table_of(rows, ("reason", lambda row: row[0]), ("rows", lambda row: row[1]))


def _verdicts(heading: str, rows: Sequence[Sequence[CaseOutcome]]) -> str:
    def verdict(row: Sequence[CaseOutcome]) -> str:
        complaints = [complaint for outcome in row for complaint in outcome.complaints]
        return f"**no**: {'; '.join(complaints)}" if complaints else "yes"

    return table_of(rows, ("", lambda row: row[0].case.name), (heading, verdict))


def _error(values: Iterable[float]) -> str:
    largest = max(values, default=0.0)
    return f"{largest:.1e}" if largest else "0"


def _drift_blocks(drift: Drift) -> list[str]:
    shown = table_of(
        list(zip(drift.distances(), drift.exact, drift.rounded, drift.nudged, strict=True)),
        ("step", lambda at: str(at[0][0])),
        ("distance of centres, float32", lambda at: f"{at[0][1]:.1e}"),
        ("distance, nudged float64", lambda at: f"{at[0][2]:.1e}"),
        ("loss, float64", lambda at: f"{at[1].loss:.5f}"),
        ("loss, float32", lambda at: f"{at[2].loss:.5f}"),
        ("PSNR of held-out images, float64", lambda at: f"{at[1].psnr:.2f} dB"),
        ("float32", lambda at: f"{at[2].psnr:.2f} dB"),
        ("nudged", lambda at: f"{at[3].psnr:.2f} dB"),
    )
    verdict = f"**It drifts**: {'; '.join(drift.complaints)}." if drift.complaints else "It does not drift."
    return [DRIFT.format(decibels=MOST_DECIBELS, times=MOST_TIMES), shown, verdict]


def _picture(outcomes: Sequence[CaseOutcome]) -> bytes:
    """A small image of every case over white, with its name above, in red where it fails."""
    from matplotlib.figure import Figure

    rows = -(-len(outcomes) // COLUMNS)
    figure = Figure(figsize=(1.55 * COLUMNS, 1.6 * rows), layout="constrained")
    for k, outcome in enumerate(outcomes):
        assert outcome.pictures is not None
        picture = outcome.pictures[0]
        shown = np.nan_to_num((picture[..., :3] + 1.0 - picture[..., 3:4]).numpy()).clip(
            0.0, 1.0
        )  # [H, W, 3] over white
        squarish = 0.2 < len(shown) / shown.shape[1] < 5.0
        axes = figure.add_subplot(rows, COLUMNS, k + 1)
        axes.imshow(shown, interpolation="nearest", aspect="equal" if squarish else "auto")
        title = textwrap.fill(outcome.case.name, 30)
        axes.set_title(title, fontsize=5.5, color="black" if outcome.passed else "red")
        axes.set_xticks([])
        axes.set_yticks([])
    content = BytesIO()
    figure.savefig(content, format="png", dpi=110, facecolor="white")
    return content.getvalue()
