from pathlib import Path

from research.studies.repeats.seeds import save, summarize_repeats
from research.studies.repeats.table import terminal_lines, write_page
from tests.research.support.scores import scores_of

SCORES = [scores_of(0, 30.0, varied=20.0), scores_of(1, 32.0, varied=24.0)]


def test_nothing_is_said_without_two_seeds(tmp_path: Path) -> None:
    assert write_page(tmp_path, "vortex", "scenes/vortex.toml", SCORES[:1]) is None
    assert list(tmp_path.iterdir()) == []


def test_the_page_lists_every_seed(tmp_path: Path) -> None:
    for scores in SCORES:
        save(tmp_path, scores)
    path = write_page(tmp_path, "vortex", "scenes/vortex.toml", SCORES)
    assert path == tmp_path / "seeds" / "seeds.md"
    text = path.read_text()
    assert "| 0 | 30.00 | 30.00 | 30.00 | 30.0000 | 1,000 | 0.50 | 100 | – | abc |" in text
    assert "| 1 | 32.00 |" in text
    assert "`python -m research.studies repeat scenes/vortex.toml --seeds 2`" in text


def test_a_terminal_shows_only_cells_with_images() -> None:
    record = summarize_repeats(SCORES)
    assert record is not None
    lines = terminal_lines(record)
    assert len(lines) == 8
    assert "31.00 ± 1.41 dB   SSIM 31.0000 ± 1.4142" in lines[3]
    assert lines[-1].startswith("isovalues: unseen settings, unseen parameters")
    empty = summarize_repeats([scores_of(0, None), scores_of(1, None)])
    assert empty is not None
    assert terminal_lines(empty) == []
