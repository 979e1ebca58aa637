"""Pages of research are wrapped where they are prose, and nowhere else."""

from research.wrapping import wrapped

WORDS = "word " * 30
ROW = f"| {WORDS}{WORDS} |"


def test_prose_is_wrapped() -> None:
    lines = wrapped(f"{WORDS}\nmore").split("\n")
    assert [len(line) <= 120 for line in lines] == [True, True]
    assert " ".join(lines) == f"{WORDS.strip()} more"


def test_items_hang() -> None:
    first, second, third = wrapped(f"- {WORDS}\n- next").split("\n")
    assert first.startswith("- word")
    assert second.startswith("  word")
    assert third == "- next"


def test_other_lines_stay() -> None:
    page = f"# {WORDS}\n\n{ROW}\n| a |\n\n![{WORDS}](a.png)\n\n```\n{WORDS}\n```\n\n    {WORDS}\n\nA break.  \nNext."
    assert wrapped(page) == page


def test_wrapping_again_changes_nothing() -> None:
    once = wrapped(f"A paragraph.\n\n- {WORDS}{WORDS}\n\n1. {WORDS}\n\n<sub>{WORDS}</sub>\n")
    assert wrapped(once) == once
