"""Build the sdist, and from it the wheel of each Python named, and try each in an empty environment.

    python .ci/check_packages.py [PYTHON ...]       by default, the Python that runs this; the network is needed

Everything is made from a clone of the commit that is checked out, in a temporary folder.  The wheel is installed without extras:
`doctor` then has to run the kernels, and to say of the rest that it is not installed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent
PACKAGES = {"catalogs", "insitu", "native", "render", "surrogate"}
OTHERS = {
    "CHANGELOG.md",
    "CITATION.cff",
    "CMakeLists.txt",
    "CONTRIBUTING.md",
    "LICENSE",
    "PKG-INFO",
    "README.md",
    "pyproject.toml",
}
MOST_BYTES = 3_000_000


def run(command: Sequence[str | Path], place: Path) -> str:
    """The output of a command that succeeds in folder `place`, where no other package of ours is on the path."""
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    ended = subprocess.run([*map(str, command)], cwd=place, env=environment, capture_output=True, text=True)
    if ended.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}\n{ended.stdout}{ended.stderr}")
    return ended.stdout


def sdist(python: Path, folder: Path) -> Path:
    """The sdist of the commit that is checked out, after its contents were compared with what they must be."""
    clone = folder / "clone"
    run(["git", "clone", "--quiet", "--depth", "1", PROJECT.as_uri(), clone], folder)
    run([python, "-m", "build", "--sdist", "--outdir", folder, clone], folder)
    (path,) = folder.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    top = {name.partition("/")[0] for name in names}
    if top != PACKAGES | OTHERS:
        raise SystemExit(
            f"{path.name} lacks {sorted((PACKAGES | OTHERS) - top)}, and has beside {sorted(top - PACKAGES - OTHERS)}"
        )
    tracked = {*run(["git", "ls-files", *PACKAGES], clone).split()}
    if lost := tracked - names:
        raise SystemExit(f"{path.name} lacks {sorted(lost)}")
    if path.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{path.name} has {path.stat().st_size:,} bytes, more than {MOST_BYTES:,}")
    return path


def try_wheel(source: Path, python: Path, folder: Path) -> str:
    """The wheel's name, after the commands of all halves and the kernels ran where it alone is installed."""
    run([python, "-m", "venv", folder / "fresh"], folder)
    commands = folder / "fresh" / "bin"
    run([commands / "python", "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, source], folder)
    (wheel,) = folder.glob("*.whl")
    run([commands / "python", "-m", "pip", "install", "--no-compile", "--quiet", wheel], folder)
    run([commands / "catalogs", "--version"], folder)
    for half in ("insitu", "surrogate"):
        report = json.loads(run([commands / half, "doctor", "--json"], folder))
        findings = {finding["name"]: finding for finding in report["findings"]}
        if findings["kernels"]["remedy"] or not findings["gs-surrogate"]["value"].endswith("site-packages"):
            raise SystemExit(f"{wheel.name}: {findings['kernels']}, {findings['gs-surrogate']}")
        if not (said := run([commands / half, "docs"], folder)).startswith("The documentation"):
            raise SystemExit(f"{wheel.name}: {half} docs said {said}")
    return wheel.name


def main(pythons: Sequence[str]) -> None:
    """Check the sdist and the wheel of each Python; ends with a message at the first that fails."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tools = folder / "tools" / "bin" / "python"
        run([sys.executable, "-m", "venv", folder / "tools"], folder)
        run([tools, "-m", "pip", "install", "--quiet", "build"], folder)
        source = sdist(tools, folder)
        print(f"{source.name}: {source.stat().st_size:,} bytes")
        for python in pythons or [sys.executable]:
            with tempfile.TemporaryDirectory() as place:
                print(f"{try_wheel(source, Path(python), Path(place))}: installed, and the kernels ran")


if __name__ == "__main__":
    main(sys.argv[1:])
