import pytest

from research.studies.repeats.seeds import seeds_section, spread, summarize_repeats
from surrogate.evaluation.scoring import METRICS
from tests.research.support.scores import scores_of


@pytest.mark.parametrize(
    ("values", "mean", "deviation"),
    [
        ([2.0], 2.0, None),
        ([1.0, 3.0], 2.0, 2.0**0.5),
        ([2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0], 5.0, (32.0 / 7.0) ** 0.5),  # squared distances 9 1 1 1 0 0 4 16
        ([30.0, 30.0, 30.0], 30.0, 0.0),
    ],
)
def test_spreads_computed_by_hand(values: list[float], mean: float, deviation: float | None) -> None:
    assert spread(values) == pytest.approx({"mean": mean, "deviation": deviation})


def test_every_number_has_its_spread() -> None:
    found = summarize_repeats(
        [scores_of(0, 30.0, varied=20.0), scores_of(1, 31.0, varied=22.0), scores_of(2, 32.0, varied=27.0)]
    )
    assert found is not None
    assert found["seeds"] == [0, 1, 2]
    assert found["machines"] == [{"processor": "abacus", "cores": 2, "system": "wood"}]
    assert found["commits"] == ["abc"]
    assert found["gaussians"] == pytest.approx({"mean": 1010.0, "deviation": 10.0})
    assert found["megabytes"] == pytest.approx({"mean": 1.5, "deviation": 1.0})
    for metric in METRICS:
        assert found[metric]["unseen_views"]["unseen_parameters"] == pytest.approx({"mean": 31.0, "deviation": 1.0})
        (varied,) = found["variations"]
        at = varied[metric]["unseen_settings"]["seen_parameters"]  # 20, 22, 27: distances -3, -1, 4 from 23
        assert at == pytest.approx({"mean": 23.0, "deviation": 13.0**0.5})
    assert varied["kind"] == "isovalue"
    assert varied["images"]["seen_settings"]["seen_parameters"] == 7


def test_fewer_than_two_seeds_have_none() -> None:
    assert summarize_repeats([]) is None
    assert summarize_repeats([scores_of(0, 30.0)]) is None


def test_cells_without_images_have_none() -> None:
    found = summarize_repeats([scores_of(0, None), scores_of(1, None)])
    assert found is not None
    assert found["psnr"]["seen_views"]["unseen_parameters"] is None


def test_the_section_shows_means_and_deviations_with_what_made_them() -> None:
    scores = [scores_of(0, 30.0, varied=20.0), scores_of(1, 32.0, varied=24.0)]
    text = "\n".join(seeds_section(summarize_repeats(scores)))
    assert "## Mean ± standard deviation over 2 seeds" in text
    assert "| unseen | unseen | 31.00 ± 1.41 | 31.00 ± 1.41 | 31.00 ± 1.41 | 31.0000 ± 1.4142 | 7 |" in text
    assert "| isovalues | parameters |" in text
    assert "| unseen | seen | 22.00 ± 2.83 | 22.00 ± 2.83 |" in text
    assert "1,005 ± 7 Gaussians, 1.00 ± 0.71 MB" in text
    assert "<sub>abacus, 2 cores; commit abc</sub>" in text
    assert seeds_section(None) == []
