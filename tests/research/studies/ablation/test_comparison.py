import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from research.studies.ablation.comparison import VariantRow, rows_of, standard_error
from research.studies.ablation.records import AblationResult
from research.studies.ablation.table import equal_steps, page, plot, unequal_times, verdict
from research.studies.ablation.variants import VARIANTS

NAMED = {variant.name: variant for variant in VARIANTS}


def results(name: str, scores: Sequence[float], error: str = "") -> list[AblationResult]:
    made = {"canonical_steps": 10, "deformation_steps": 30, "seconds": 2.0, "ssim": 0.9, "images": 8, "gaussians": 50}
    kept = [AblationResult(name, seed, 2.0, "mark", {}, psnr=psnr, **made) for seed, psnr in enumerate(scores)]
    return kept + ([AblationResult(name, len(scores), 2.0, "mark", {}, error=error)] if error else [])


def rows(**scores: Sequence[float]) -> dict[str, VariantRow]:
    found = rows_of({NAMED[n.replace("_", "-")]: results(n.replace("_", "-"), s) for n, s in scores.items()})
    return {row.variant.name: row for row in found}


def test_statistics_agree_with_numpy() -> None:
    default, doubled = [30.1, 30.4, 29.9], [28.0, 28.7]
    found = rows(default=default, samples_2=doubled)["samples-2"]
    error = math.hypot(np.std(default, ddof=1) / np.sqrt(3), np.std(doubled, ddof=1) / np.sqrt(2))
    assert found.psnr == pytest.approx(np.mean(doubled))
    assert found.spread == pytest.approx(np.std(doubled, ddof=1))
    assert found.difference == pytest.approx(np.mean(doubled) - np.mean(default))
    assert found.error == pytest.approx(error)


def test_the_standard_error_is_that_of_many_repeated_experiments() -> None:
    random = np.random.default_rng(3)
    some, others = random.normal(0.0, 0.3, (4000, 3)), random.normal(1.0, 0.1, (4000, 5))
    errors = [standard_error(a.tolist(), b.tolist()) for a, b in zip(some, others, strict=True)]
    spread = np.std(some.mean(axis=1) - others.mean(axis=1))
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(spread, rel=0.03)  # type: ignore[arg-type]


def test_one_seed_has_no_spread_and_no_error() -> None:
    found = rows(default=[30.0, 30.2], samples_2=[28.0])["samples-2"]
    assert (found.spread, found.error, found.is_sure) == (None, None, False)
    assert found.difference == pytest.approx(-2.1)
    assert "takes two seeds" in verdict(list(rows(default=[30.0], samples_2=[28.0]).values()))


def test_what_takes_another_ones_steps_is_compared_with_that() -> None:
    found = rows(default=[30.0, 30.2], samples_2=[28.0, 28.2], default_in_samples_2_steps=[29.0, 29.4, 35.0])
    row = found["default-in-samples-2-steps"]
    assert row.reference == "samples-2"
    assert row.difference == pytest.approx(1.1)  # of the two seeds that both have
    assert row.error == pytest.approx(np.std([1.0, 1.2], ddof=1) / np.sqrt(2))
    assert equal_steps(list(found.values())) == [
        "After equally many steps (40), default-in-samples-2-steps differs from samples-2 by +1.10 ± 0.10 dB."
    ]
    assert "default-in-samples-2-steps" not in verdict(list(found.values()))


def test_the_verdict_names_what_exceeds_two_standard_errors() -> None:
    found = rows(default=[30.0, 30.2], samples_2=[28.0, 28.2], joint=[30.1, 30.4])
    assert verdict(list(found.values())) == (
        "The difference from the default exceeds 2 of its standard errors for samples-2 (-2.00 dB)."
    )
    assert verdict([found["default"], found["joint"]]).startswith("No difference from the default exceeds")


def test_what_took_another_time_is_named() -> None:
    found = rows(default=[30.0, 30.2], default_in_samples_2_steps=[29.0])
    assert unequal_times(list(found.values())) == []
    late = {name: replace(row, results=[replace(r, seconds=2.4) for r in row.results]) for name, row in found.items()}
    (sentence,) = unequal_times(list(late.values()))
    assert sentence.endswith("(`--again` fits them again): default seed 0 (2.4 s), default seed 1 (2.4 s).")


def test_the_page_shows_results_and_says_why_there_are_none() -> None:
    found = rows_of(
        {
            NAMED["default"]: results("default", [30.0, 30.2]),
            NAMED["joint"]: results("joint", [29.0], error="out of | luck"),
            NAMED["start-sfm"]: results("start-sfm", [], error="too few points"),
        }
    )
    lines = page("blobs", 2.0, found, pictured=True).splitlines()
    assert "| **default** | nothing | 30.10 ± 0.14 | – | 0.9000 | 40 | 2.0 | 50 | 2 |" in lines
    assert "| joint | canonical_steps = 0 | 29.00 | -1.10 | 0.9000 | 40 | 2.0 | 50 | 1 |" in lines
    assert "| joint | 1 | out of / luck |" in lines
    assert "| start-sfm | 0 | too few points |" in lines
    assert "![PSNR of every seed](ablation.png)" in lines
    assert (plot(found) or b"").startswith(b"\x89PNG")


def test_nothing_but_failures_still_makes_a_page() -> None:
    found = rows_of({NAMED["start-sfm"]: results("start-sfm", [], error="too few points")})
    lines = page("blobs", 2.0, found, pictured=False).splitlines()
    assert "| start-sfm | 0 | too few points |" in lines
    assert any("python -m research.studies ablate scenes/blobs.toml --seconds 2`" in line for line in lines)
    assert plot(found) is None
