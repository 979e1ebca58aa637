"""Tables of image quality: novel views, unseen parameters, unseen settings, and all of them at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from catalogs.vocabulary.variations import KINDS
from research.benchmarks.results.parts import BASE, ReportPart
from surrogate.evaluation.scoring import PERCEPTUAL_METRICS
from surrogate.evaluation.tables import HEADINGS, NOTHING, table_of

UPPER_BOUND, TRIVIAL = "upper bound (surrogate there), dB", "best trivial predictor, dB"
CENTER = "the same model at the centre of the parameters, dB"
Cell = tuple[str, str]  # row and column


class QualityTable(NamedTuple):
    """A section of the page: its title, description and table."""

    title: str
    text: str
    table: str


def quality_tables(parts: Sequence[ReportPart]) -> list[QualityTable]:
    """Novel views, unseen simulation parameters, unseen settings of each kind, and all of them at once."""
    seen = "seen_views", "seen_parameters"
    return [
        _seen_and_unseen(
            "Novel views",
            "Training members, from the views that training saw and from the others.  Trivial predictors mix stored pictures of "
            "other members, so there are none here.",
            parts,
            (BASE, "views"),
            (seen, ("unseen_views", "seen_parameters")),
            without=TRIVIAL,
        ),
        _seen_and_unseen(
            "Unseen simulation parameters",
            "Test members, from views that training saw of others; upper bounds are measured at unseen views only.",
            parts,
            (BASE, "parameters"),
            (seen, ("seen_views", "unseen_parameters")),
            without=UPPER_BOUND,
        ),
        *(
            _seen_and_unseen(
                f"Unseen {kind.plural}",
                f"Training members at unseen views, under {kind.plural} that training showed and under others.  Trivial "
                "predictors have stored pictures of the same member and view.",
                parts,
                (kind.kind, kind.plural),
                (("seen_settings", "seen_parameters"), ("unseen_settings", "seen_parameters")),
            )
            for kind in KINDS.values()
            if kind.continuous
        ),
        _everything_unseen(parts),
    ]


def _seen_and_unseen(
    title: str, text: str, parts: Sequence[ReportPart], of: tuple[str, str], cells: tuple[Cell, Cell], without: str = ""
) -> QualityTable:
    """Parts of a kind with images in the second of two cells; their names say what is seen in the first alone."""
    (kind, names), (seen, unseen) = of, cells
    return _made(
        title,
        text,
        [part for part in parts if part.kind == kind and part.images(*unseen)],
        lambda _: unseen,
        (f"seen {names}, PSNR (dB)", lambda part: part.figure("psnr", *seen)),
        (f"**unseen {names}**, PSNR (dB)", lambda part: part.figure("psnr", *unseen)),
        without=without,
    )


def _everything_unseen(parts: Sequence[ReportPart]) -> QualityTable:
    """Unseen views and parameters at once, and unseen settings where there are any."""
    shown = [part for part in parts if part.images(*_joint(part))]
    perceptual = [m for m in PERCEPTUAL_METRICS if any(part.figure(m, *_joint(part)) != NOTHING for part in shown)]
    return _made(
        "Unseen views and unseen parameters at once",
        "Test members at test views; under isovalues and transfer functions that are unseen too, or fields, which training "
        f"shows all of.  {_perceptual_text(perceptual)}",
        shown,
        _joint,
        ("what", lambda part: part.what),
        ("PSNR (dB)", lambda part: part.figure("psnr", *_joint(part))),
        perceptual=perceptual,
    )


def _made(
    title: str,
    text: str,
    parts: Sequence[ReportPart],
    at: Callable[[ReportPart], Cell],
    *first: tuple[str, Callable[[ReportPart], str]],
    perceptual: Sequence[str] = (),
    without: str = "",
) -> QualityTable:
    """A table with a row for each part, about the cell `at`."""

    def figure(metric: str) -> Callable[[ReportPart], str]:
        return lambda part: part.figure(metric, *at(part))

    columns = (
        ("scene", lambda part: f"`{part.scene}`"),
        *first,
        *((HEADINGS[metric], figure(metric)) for metric in ("psnr_foreground", "ssim", *perceptual)),
        (CENTER, lambda part: part.at_center(*at(part))),
        (UPPER_BOUND, ReportPart.beside_upper_bound),
        (TRIVIAL, lambda part: part.best_trivial(*at(part))),
        ("seeds", ReportPart.seeds),
        ("images", lambda part: str(part.images(*at(part)))),
    )
    shown = table_of(parts, *(column for column in columns if column[0] != without))
    nothing = "No scene has a report of such images yet."
    return QualityTable(title, text, shown if parts else nothing)


def _joint(part: ReportPart) -> Cell:
    """The cell of a part with the most unseen conditions."""
    if part.kind == BASE:
        return "unseen_views", "unseen_parameters"
    unseen = "unseen_settings", "unseen_parameters"
    return unseen if part.images(*unseen) else ("seen_settings", "unseen_parameters")


def _perceptual_text(metrics: Sequence[str]) -> str:
    """Remarks on metrics that are measured on some images only, and on those that no report has."""
    shown, missing = ([HEADINGS[m] for m in PERCEPTUAL_METRICS if (m in metrics) == there] for there in (True, False))
    texts = [f"{', '.join(shown)}: of the scene's own seed, on some of the images."] if shown else []
    return "  ".join(
        [*texts, *([f"{', '.join(missing)}: missing, for the reasons that reports give."] if missing else [])]
    )
