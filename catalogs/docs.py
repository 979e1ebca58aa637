"""The documentation's place: `surrogate docs` and `insitu docs` open its site, or say where it is."""

from __future__ import annotations

import importlib.metadata
import os
import sys
import webbrowser
from pathlib import Path

import click

CHECKOUT = Path(__file__).resolve().parents[1]


def place(checkout: Path = CHECKOUT) -> tuple[str, str]:
    """The site's address, empty where there is none on this machine, and a sentence that says where the documentation is."""
    sources, built = checkout / "docs", checkout / "build" / "site"
    is_ours = (checkout / "pyproject.toml").is_file()  # other packages install a folder `docs` beside ours
    if is_ours and (built / "index.html").is_file():
        return (built / "index.html").as_uri(), f"The documentation: {built / 'index.html'}"
    if is_ours and (sources / "conf.py").is_file():
        build = f"pip install 'gs-surrogate[docs]' && python -m sphinx {sources} {built}"
        return "", f"The documentation's pages are in {sources}. Build its site: {build}"
    for entry in importlib.metadata.metadata("gs-surrogate").get_all("Project-URL") or ():
        name, _, address = entry.partition(", ")
        if name == "Documentation":
            return address, f"The documentation: {address}"
    return (
        "",
        "The documentation is not part of the wheel. It is the folder `docs` of a checkout, where this command says how to build "
        "its site. Here, `--help` describes commands and `help(insitu.Session)` Python.",
    )


@click.command()
def docs() -> None:
    """Open the documentation in a browser, or say where it is."""
    address, sentence = place()
    click.echo(sentence)
    if address and (sys.platform == "darwin" or os.environ.keys() & {"DISPLAY", "WAYLAND_DISPLAY"}):
        webbrowser.open(address)
