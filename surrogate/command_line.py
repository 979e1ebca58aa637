"""What the commands of all rooms share: their arguments, a scene with its data set, and errors told in one line."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from catalogs.catalog import Catalog
    from surrogate.model import Surrogate
    from surrogate.settings import TrainingSettings

RESULTS, MEASURED = Path("runs"), Path("docs/records")
SCENE = click.argument("scene", type=click.Path(dir_okay=False, path_type=Path))
RUN = click.argument("run", type=click.Path(exists=True, file_okay=False, path_type=Path))
RUNS = click.option(
    "--runs", default=RESULTS, show_default=True, help="Folder of all results.", type=click.Path(path_type=Path)
)
RECORDS = click.option(
    "--records",
    type=click.Path(path_type=Path),
    help="Folder of all measured records; what one of the same settings and code answers is not done again.  "
    "[default: that of --runs; of repeat and ablate docs/records, where that is and --runs is not given]",
)


@dataclass(frozen=True, eq=False)
class OpenScene:
    """A scene with its data set.

    Attributes
    ----------
    folder : of its results, such as runs/tgv-dvr.
    records : of what was measured of it, such as docs/records/tgv-dvr.
    """

    name: str
    settings: TrainingSettings
    catalog: Catalog
    folder: Path
    records: Path

    @classmethod
    def open(cls, path: Path, runs: Path, records: Path | None = None) -> OpenScene:
        """Read the scene file at `path` and find what is there; raises ClickException for what the user can mend."""
        from catalogs.catalog import Catalog
        from catalogs.scene import Scene
        from surrogate.settings import TrainingSettings

        with one_line_errors():
            scene = Scene.load(path)
            folder = scene.run_directory(runs)
            if not (folder / "catalog.cdb").is_dir():
                raise FileNotFoundError(
                    f"{folder / 'catalog.cdb'} does not exist yet: make it with `make dataset SCENE={scene.name}`"
                )
            catalog = Catalog.open(folder / "catalog.cdb")
        try:
            settings = TrainingSettings(**scene.training)
        except ValueError as error:
            raise click.ClickException(f"scene {scene.path}: {error}") from error
        if records is None:
            records = MEASURED if runs == RESULTS and MEASURED.is_dir() else runs
        return cls(scene.name, settings, catalog, folder, records / scene.name)

    @property
    def model(self) -> Path:
        """Where its surrogate is kept."""
        return self.folder / "surrogate"


def load_surrogate(directory: Path) -> Surrogate:
    """The surrogate in a folder; raises ClickException where there is none, or none that can be read."""
    from surrogate.model import Surrogate

    try:
        return Surrogate.load(directory)
    except (FileNotFoundError, ValueError) as error:
        raise click.ClickException(f"{error} (`make train` makes one)") from error


@contextlib.contextmanager
def one_line_errors(*more: type[Exception], interrupted: str = "", extra: str = "") -> Iterator[None]:
    """Tell ValueError, OSError and `more` in one line, without a traceback; say `interrupted` after Ctrl-C.

    With `extra` a package that is missing is told too, with the extra of this project that installs it.
    """
    told: tuple[type[Exception], ...] = (ValueError, OSError, *more)
    try:
        yield
    except told as error:
        raise click.ClickException(str(error)) from error
    except ModuleNotFoundError as error:
        if not extra:
            raise
        command = f"pip install 'gs-surrogate[{extra}]'"
        raise click.ClickException(f"this needs the package {error.name}: {command}") from error
    except KeyboardInterrupt:
        if interrupted:
            click.echo(f"interrupted: {interrupted}", err=True)
        raise
