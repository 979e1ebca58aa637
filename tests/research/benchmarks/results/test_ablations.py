"""Variants stand in the group whose question they answer, with means and deviations over seeds."""

import pytest

from research.benchmarks.results.ablations import GROUPS, group_of, study_section
from research.benchmarks.results.studies import BASE, VISUALIZATION, StudyResults, kinds_of
from research.studies.ablation.comparison import rows_of
from research.studies.ablation.records import AblationResult
from research.studies.ablation.variants import VARIANTS, VISUALIZATION_VARIANTS
from surrogate.storage.records import Provenance


def results(name: str, *psnr: float, steps: int = 100, error: str = "") -> list[AblationResult]:
    made = {"provenance": Provenance("bead", "", {"processor": "abacus", "cores": 1}), "deformation_steps": steps}
    return [
        AblationResult(
            name, seed, 60.0, "mark", {"seed": seed}, psnr=value, ssim=0.9, seconds=60.0, images=8, error=error, **made
        )
        for seed, value in enumerate(psnr)
    ]


@pytest.mark.parametrize(
    ("name", "group"),
    [
        ("default", "reference"),
        ("samples-2-in-default-steps", "equal steps"),
        ("default-in-samples-2-steps", "equal steps"),
        ("start-sfm", "start"),
        ("joint", "training strategy"),
        ("samples-2", "training strategy"),
        ("gaussians-x2", "size"),
        ("latent-8", "size"),
    ],
)
def test_variants_are_grouped_by_what_they_change(name: str, group: str) -> None:
    assert group_of(next(v for v in VARIANTS if v.name == name)) == group


def test_every_variant_has_a_group() -> None:
    assert {group_of(variant) for variant in VARIANTS} == set(GROUPS)
    assert {group_of(variant) for variant in VISUALIZATION_VARIANTS} <= set(GROUPS)


def test_a_table_shows_differences_at_equal_time_and_at_equal_steps() -> None:
    known = {"default": results("default", 30.0, 32.0), "samples-2": results("samples-2", 20.0, 22.0, steps=10)}
    known["default-in-samples-2-steps"] = results("default-in-samples-2-steps", 25.0, 29.0, steps=10)
    known["start-sfm"] = results("start-sfm", 0.0, error="ValueError: no points")
    rows = rows_of({v: known[v.name] for v in VARIANTS if v.name in known})
    text = "\n".join(study_section(StudyResults(BASE, 60.0, rows)))
    assert "| **reference** | default | nothing | 31.00 ± 1.41 | – | 0.9000 | 100 | 60 | 2 |" in text
    # standard errors: sqrt(2 / 2 + 2 / 2) of two means; sqrt(2) / sqrt(2) of the paired differences 5 and 7
    assert (
        "| **training strategy** | samples-2 | samples = 2 | 21.00 ± 1.41 | -10.00 ± 1.41 | 0.9000 | 10 | 60 | 2 |"
        in text
    )
    assert (
        "| **equal steps** | default-in-samples-2-steps | steps of samples-2 | 27.00 ± 2.83 | "
        "+6.00 ± 1.00 from samples-2 | 0.9000 | 10 |"
    ) in text
    assert (
        "After equally many steps (10), default-in-samples-2-steps differs from samples-2 by +6.00 ± 1.00 dB." in text
    )
    assert "Without a result: start-sfm (ValueError: no points)." in text
    assert f"{len(VARIANTS) - 4} of {len(VARIANTS)} variants were not run: no-relocation, " in text


def test_of_an_earlier_page_the_variants_without_a_row_are_named() -> None:
    lines = [
        "|  | default | nothing |",
        "|  | joint | canonical_steps = 0 |",
        "Without a result: no-relocation (diverged).",
    ]
    text = "\n".join(study_section(StudyResults(BASE, published={"lines": lines, "sources": ""})))
    missing = text.split("were not run: ")[1].split(". ")[0].split(", ")
    assert {"default", "joint", "no-relocation"}.isdisjoint(missing)
    assert len(missing) == len(VARIANTS) - 3
    assert "samples-2" in missing


def test_an_earlier_page_says_what_its_rows_of_the_papers_field_measure() -> None:
    published = {"lines": ["|  | paper | deformation = paper |"], "sources": ""}
    assert "Those rows measure what a step of it costs" in study_section(StudyResults(BASE, published=published))[1]


def test_only_scenes_with_variations_have_a_study_of_them() -> None:
    assert kinds_of(0) == [BASE]
    assert kinds_of(2) == [BASE, VISUALIZATION]
    assert VISUALIZATION.command("vortex") == "python -m research.studies ablate scenes/vortex.toml --visualization"
