"""The tables of how good: novel views, unseen parameters, unseen settings, and all of them at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.results.parts import BASE, Part
from catalogs.variations import KINDS
from surrogate.evaluation.scoring import PERCEPTUAL_METRICS
from surrogate.evaluation.tables import HEADINGS, NOTHING, table_of

FOREGROUND, SSIM = "PSNR of the foreground (dB)", "SSIM"
CEILING, TRIVIAL = "ceiling (surrogate there), dB", "best trivial predictor, dB"
UNSEEN = "unseen_views", "unseen_parameters"


@dataclass(frozen=True, eq=False)
class QualityTable:
    """A section of the page: its title, what it shows, its table, and the scenes in it; none without any."""

    title: str
    text: str
    table: str
    scenes: Sequence[str]


Column = tuple[str, Callable[[Part], str]]


def quality_tables(parts: Sequence[Part]) -> list[QualityTable]:
    """All tables about how good pictures are."""
    return [novel_views(parts), unseen_parameters(parts), *unseen_settings(parts), everything_unseen(parts)]


def novel_views(parts: Sequence[Part]) -> QualityTable:
    """Seen parameters from seen and from unseen views."""
    at = "unseen_views", "seen_parameters"
    return _made(
        "Novel views",
        "Training members, from the views that training saw and from the others.  Trivial predictors mix stored pictures of other "
        "members, so there are none here.",
        [part for part in parts if part.kind == BASE and part.has(*at)],
        ("seen views, PSNR (dB)", lambda part: part.figure("psnr", "seen_views", "seen_parameters")),
        ("**unseen views**, PSNR (dB)", lambda part: part.figure("psnr", *at)),
        *_details(at),
        (CEILING, Part.beside_ceiling),
        *_counts(at),
    )


def unseen_parameters(parts: Sequence[Part]) -> QualityTable:
    """Seen and unseen simulation parameters from seen views."""
    at = "seen_views", "unseen_parameters"
    return _made(
        "Unseen simulation parameters",
        "Test members, from views that training saw of others; ceilings are measured at unseen views only.",
        [part for part in parts if part.kind == BASE and part.has(*at)],
        ("seen parameters, PSNR (dB)", lambda part: part.figure("psnr", "seen_views", "seen_parameters")),
        ("**unseen parameters**, PSNR (dB)", lambda part: part.figure("psnr", *at)),
        *_details(at),
        (TRIVIAL, lambda part: part.best_trivial(*at)),
        *_counts(at),
    )


def unseen_settings(parts: Sequence[Part]) -> list[QualityTable]:
    """Seen and unseen isovalues, and transfer functions, of training members at unseen views; a table for each kind."""
    at = "unseen_settings", "seen_parameters"
    return [
        _made(
            f"Unseen {form.plural}",
            f"Training members at unseen views, under {form.plural} that training showed and under others.  Trivial predictors "
            "have stored pictures of the same member and view.",
            [part for part in parts if part.kind == form.kind and part.has(*at)],
            (f"seen {form.plural}, PSNR (dB)", lambda part: part.figure("psnr", "seen_settings", "seen_parameters")),
            (f"**unseen {form.plural}**, PSNR (dB)", lambda part: part.figure("psnr", *at)),
            *_details(at),
            (CEILING, Part.beside_ceiling),
            (TRIVIAL, lambda part: part.best_trivial(*at)),
            *_counts(at),
        )
        for form in KINDS.values()
        if any(part.kind == form.kind and part.has(*at) for part in parts) or form.continuous
    ]


def everything_unseen(parts: Sequence[Part]) -> QualityTable:
    """Unseen views and parameters at once, and unseen settings where there are any."""
    shown = [part for part in parts if part.has(*_joint(part))]
    perceptual = [m for m in PERCEPTUAL_METRICS if any(part.figure(m, *_joint(part)) != NOTHING for part in shown)]
    return _made(
        "Unseen views and unseen parameters at once",
        "Test members at test views; under isovalues and transfer functions that are unseen too, or fields, which training "
        "shows all of.  "
        f"{_perceptual_text(perceptual)}",
        shown,
        ("what", lambda part: part.what),
        ("PSNR (dB)", lambda part: part.figure("psnr", *_joint(part))),
        (FOREGROUND, lambda part: part.figure("psnr_foreground", *_joint(part))),
        (SSIM, lambda part: part.figure("ssim", *_joint(part))),
        *(
            (HEADINGS[metric], lambda part, m=metric: part.figure(m, *_joint(part)))  # type: ignore[misc]
            for metric in perceptual
        ),
        (CEILING, Part.beside_ceiling),
        (TRIVIAL, lambda part: part.best_trivial(*_joint(part))),
        ("seeds", Part.seeds),
        ("images", lambda part: _images(part, *_joint(part))),
    )


def _joint(part: Part) -> tuple[str, str]:
    """The cell of a part in which most is unseen."""
    if part.kind == BASE:
        return UNSEEN
    unseen = "unseen_settings", "unseen_parameters"
    return unseen if part.has(*unseen) else ("seen_settings", "unseen_parameters")


def _perceptual_text(metrics: Sequence[str]) -> str:
    """What is to be known of metrics that look at some images only, and of those that no report has."""
    shown, missing = ([HEADINGS[m] for m in PERCEPTUAL_METRICS if (m in metrics) == there] for there in (True, False))
    texts = [f"{', '.join(shown)}: of the scene's own seed, on some of the images."] if shown else []
    return "  ".join(
        [*texts, *([f"{', '.join(missing)}: missing, for the reasons that reports give."] if missing else [])]
    )


def _details(at: tuple[str, str]) -> list[Column]:
    return [
        (FOREGROUND, lambda part: part.figure("psnr_foreground", *at)),
        (SSIM, lambda part: part.figure("ssim", *at)),
    ]


def _counts(at: tuple[str, str]) -> list[Column]:
    return [("seeds", Part.seeds), ("images", lambda part: _images(part, *at))]


def _images(part: Part, row: str, column: str) -> str:
    return str(part.record["images"][row][column])


def _made(title: str, text: str, parts: Sequence[Part], *columns: Column) -> QualityTable:
    shown = table_of(parts, ("scene", lambda part: f"`{part.scene}`"), *columns)
    nothing = "No scene has a report of such images yet."
    return QualityTable(title, text, shown if parts else nothing, list(dict.fromkeys(part.scene for part in parts)))
