"""`python -m research.studies`: trainings in numbers, to say how good a surrogate is and what each of its choices is worth."""

from __future__ import annotations

import click

from research.studies.commands import ablate, ceiling, compare, repeat, stress


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Repeat, vary and compare trainings, and measure what they could reach."""


for command in (repeat, ablate, compare, ceiling, stress):
    main.add_command(command)

if __name__ == "__main__":
    main(prog_name="python -m research.studies")
