from pathlib import Path

from surrogate.evaluation.evaluate import evaluate
from surrogate.evaluation.scoring import METRICS, mean
from surrogate.studies.repeats.scoring import STAGE, score_model
from tests.support.varied_blobs import varied_catalog, varied_surrogate


def test_variations_are_scored_as_in_a_report(tmp_path: Path) -> None:
    surrogate = varied_surrogate()
    catalog = varied_catalog(tmp_path / "varied.cdb", surrogate)
    told: list[tuple[str, int, int]] = []
    found = score_model(surrogate, catalog, progress=lambda *counts: told.append(counts))["variations"]
    expected = evaluate(surrogate, catalog).variations
    assert [varied["kind"] for varied in found] == ["isovalue", "transfer_function"]
    for varied, evaluation in zip(found, expected, strict=True):
        for row, columns in evaluation.cells.items():
            for column, scored in columns.items():
                assert varied["images"][row][column] == len(scored)
                for metric in METRICS:
                    assert varied[metric][row][column] == mean(scored, metric)
    assert found[0]["psnr"]["unseen_settings"]["unseen_parameters"] > 50.0  # the truth but for 8 bits
    assert told[-1][0] == STAGE
    assert told[-1][1] == told[-1][2] == max(done for _, done, _ in told)
