"""Run docs/start/tutorial.ipynb and store the outputs of its cells.

    python -m research.benchmarks.explorer.tutorial [--output FILE]

Takes about a minute on two cores. The notebook's files go into a temporary folder.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from research.benchmarks.page import DOCS, PROJECT, command_line

if TYPE_CHECKING:
    import nbformat

NOTEBOOK = DOCS / "start" / "tutorial.ipynb"
LIVE = "live"  # tag of cells whose output needs their kernel
SECONDS = 600  # for one cell


def executed(notebook: nbformat.NotebookNode, folder: Path) -> nbformat.NotebookNode:
    """The notebook with the outputs of a fresh kernel that works in `folder`.

    Raises `nbclient.exceptions.CellExecutionError` where a cell fails.
    """
    from nbclient import NotebookClient  # seconds

    here = {"TMPDIR": str(folder), "IPYTHONDIR": str(folder / ".ipython"), "PYTHONPATH": str(PROJECT)}
    client = NotebookClient(
        notebook,
        timeout=SECONDS,
        kernel_name="python3",
        coalesce_streams=True,
        resources={"metadata": {"path": str(folder)}},
    )
    done: nbformat.NotebookNode = client.execute(env={**os.environ, **here})
    return done


def reproducible(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook without outputs that change between runs or machines: times of cells, versions, live frames."""
    import nbformat

    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if LIVE in cell.metadata.get("tags", ()):
            cell.outputs = []
    notebook.metadata = nbformat.from_dict(
        {"kernelspec": notebook.metadata.kernelspec, "language_info": {"name": "python"}}
    )
    return notebook


def main() -> None:
    """Write docs/start/tutorial.ipynb anew."""
    import nbformat

    parser = command_line("explorer.tutorial", __doc__)
    parser.add_argument("--output", type=Path, default=NOTEBOOK, help="file that the executed notebook is written to")
    output = parser.parse_args().output
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        nbformat.write(reproducible(executed(notebook, Path(folder))), output)
    print(output)


if __name__ == "__main__":
    main()
