"""Numbers stand in the cells that they belong to: report, seeds, upper bound and best trivial predictor."""

from pathlib import Path

from research.benchmarks.results.parts import parts_of
from research.benchmarks.results.quality import quality_tables
from research.benchmarks.results.scenes import SceneResults
from research.studies.repeats.seeds import summarize_repeats
from surrogate.evaluation.cases import SETTINGS
from tests.research.support.results import report_of, upper_bound_entry
from tests.research.support.scores import cells_of, scores_of

TITLES = [
    "Novel views",
    "Unseen simulation parameters",
    "Unseen isovalues",
    "Unseen transfer functions",
    "Unseen views and unseen parameters at once",
]


def scene(**known: object) -> SceneResults:
    return SceneResults("vortex", "A vortex", Path("runs/vortex"), "volume rendering", **known)  # type: ignore[arg-type]


def shown(results: SceneResults) -> dict[str, list[dict[str, str]]]:
    """The rows of every table by its title, their cells by column."""
    found = {}
    for quality in quality_tables(parts_of([results])):
        cells = [
            [cell.strip() for cell in line.strip("|").split("|")]
            for line in quality.table.splitlines()
            if line.startswith("|")
        ]
        found[quality.title] = [dict(zip(cells[0], row, strict=True)) for row in cells[2:]]
    return found


def test_a_report_alone_fills_the_tables() -> None:
    rows = shown(scene(report=report_of("vortex", "mark", 30.0)))
    assert list(rows) == TITLES
    assert rows["Unseen isovalues"] == rows["Unseen transfer functions"] == []
    (views,), (parameters,), (joint,) = rows[TITLES[0]], rows[TITLES[1]], rows[TITLES[4]]
    assert views["scene"] == "`vortex`"
    assert views["**unseen views**, PSNR (dB)"] == "30.00"
    assert views["upper bound (surrogate there), dB"] == "–"
    assert parameters["best trivial predictor, dB"] == joint["best trivial predictor, dB"] == "31.00 (nearest member)"
    assert (joint["what"], joint["PSNR (dB)"], joint["SSIM"]) == ("volume rendering", "30.00", "30.0000")
    assert (joint["seeds"], joint["images"]) == ("1", "7")
    assert joint["FLIP"] == "0.0125"
    assert "LPIPS" not in joint


def test_seeds_give_means_and_deviations() -> None:
    repeats = summarize_repeats([scores_of(0, 30.0, varied=20.0), scores_of(1, 32.0, varied=22.0)])
    rows = shown(scene(report=report_of("vortex", "mark", 30.0, isovalues=20.0), repeats=repeats))
    (views,), (isovalues,) = rows[TITLES[0]], rows[TITLES[2]]
    assert views["**unseen views**, PSNR (dB)"] == "31.00 ± 1.41"  # distances 1, 1 from 31: sqrt(2 / 1)
    assert views["seeds"] == "2"
    assert isovalues["**unseen isovalues**, PSNR (dB)"] == "21.00 ± 1.41"
    assert rows[TITLES[4]][0]["FLIP"] == "0.0125"  # which seeds do not have


def test_each_part_stands_beside_its_own_upper_bound() -> None:
    upper_bounds = [upper_bound_entry("mark", 33.0), upper_bound_entry("mark", 23.0, "iso=1.5", isovalue=1.5)]
    rows = shown(scene(report=report_of("vortex", "mark", 30.0, isovalues=20.0), upper_bounds=upper_bounds))
    base, isovalues = rows[TITLES[4]]
    assert base["upper bound (surrogate there), dB"] == "33.00 (32.50)"
    assert isovalues["upper bound (surrogate there), dB"] == "23.00 (22.50)"
    assert isovalues["what"] == "isovalues"
    assert isovalues["best trivial predictor, dB"] == "31.00 (nearest trained setting)"
    assert isovalues["FLIP"] == "–"


CENTER = "the same model at the centre of the parameters, dB"
TRIVIAL = "best trivial predictor, dB"


def test_the_model_at_the_centre_of_its_parameters_stands_beside_every_table_that_knows_it() -> None:
    report = report_of("vortex", "mark", 30.0, isovalues=20.0)
    assert {row[CENTER] for of in shown(scene(report=report)).values() for row in of} == {"–"}  # of an earlier record
    report["at_center"] = {"parameters": {"p": 0.5}, **cells_of(27.0)}
    report["variations"][0]["at_center"] = {"parameters": {"p": 0.5}, **cells_of(17.0, SETTINGS)}
    rows = shown(scene(report=report))
    assert [[row[CENTER] for row in of] for of in rows.values()] == [
        ["27.00"],
        ["27.00"],
        ["17.00"],
        [],
        ["27.00", "17.00"],
    ]


def test_a_predictor_says_what_its_figure_is_cut_and_capped_by() -> None:
    report = report_of("vortex", "mark", 58.5, isovalues=20.0)
    predictor = report["trivial_predictors"][0]
    predictor["psnr_of_mean_error"] = {"unseen_views": {"unseen_parameters": 63.25}}
    isovalues = report["variations"][0]
    isovalues["settings_trained"] = 7
    isovalues["trivial_predictors"] = [
        {
            "name": "nearest trained setting",
            "psnr": {"seen_parameters": 46.0, "unseen_parameters": 38.0},
            "settings_shown": {"seen_parameters": [7, 7], "unseen_parameters": [3, 4], "validation": [1, 1]},
        }
    ]
    rows = shown(scene(report=report))
    base, varied = rows[TITLES[4]]
    assert base[TRIVIAL] == "59.50 (nearest member; of the mean error 63.25)"
    capped = "from 3 to 4 of 7 trained isovalues; with 7, at seen parameters, 46.00"
    assert varied[TRIVIAL] == f"38.00 (nearest trained setting; {capped})"
    assert rows[TITLES[2]][0][TRIVIAL] == "46.00 (nearest trained setting)"


def test_cells_without_images_have_no_row() -> None:
    report = report_of("vortex", "mark", 30.0)
    report["images"]["unseen_views"]["unseen_parameters"] = 0
    rows = shown(scene(report=report))
    assert rows[TITLES[4]] == []
    assert len(rows[TITLES[0]]) == 1


def test_without_any_report_every_table_says_so() -> None:
    for quality in quality_tables(parts_of([scene()])):
        assert quality.table == "No scene has a report of such images yet."


def test_a_field_called_like_a_parameter_takes_no_upper_bound_from_the_base() -> None:
    report = report_of("vortex", "mark", 30.0, isovalues=20.0)
    report["variations"][0] |= {"kind": "field", "parameters": [{"name": "p", "low": 0.0, "high": 1.0, "unit": ""}]}
    base, field = parts_of([scene(report=report, upper_bounds=[upper_bound_entry("mark", 32.0)])])
    assert base.beside_upper_bound() == "32.00 (31.50)"
    assert field.beside_upper_bound() == "–"
