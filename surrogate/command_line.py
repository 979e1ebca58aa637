"""Arguments and runs that all commands share."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from catalogs.commands import one_line_errors

if TYPE_CHECKING:
    from catalogs.store.catalog import Catalog
    from surrogate.model import Surrogate
    from surrogate.settings import TrainingSettings
    from surrogate.storage.runs import RunFolder

RESULTS = Path("runs")
SCENE = click.argument("scene", metavar="SCENE|RUN", type=click.Path(path_type=Path))
RUN = click.argument("run", type=click.Path(exists=True, file_okay=False, path_type=Path))
RUNS = click.option(
    "--runs", default=RESULTS, show_default=True, help="Folder of all results.", type=click.Path(path_type=Path)
)


@dataclass(frozen=True, eq=False)
class OpenRun:
    """A run with its catalog, as a scene or a run's folder names it.

    Attributes
    ----------
    folder : of its results, such as runs/tgv.
    source : what named it on the command line.
    """

    name: str
    settings: TrainingSettings
    catalog: Catalog
    folder: Path
    source: Path

    @classmethod
    def open(cls, path: Path, runs: Path) -> OpenRun:
        """The run that `path` names, a scene file or a run's folder; raises ClickException for what the user can mend."""
        kind = kind_of(path)
        if kind == "catalog":
            raise click.ClickException(
                f"{path} is a catalog: `surrogate train {path}` makes a run of it, which goes here"
            )
        return cls._of_scene(path, runs) if kind == "scene" else cls._of_folder(path)

    @classmethod
    def _of_scene(cls, path: Path, runs: Path) -> OpenRun:
        from catalogs.store.catalog import Catalog
        from catalogs.vocabulary.scene import Scene
        from surrogate.settings import TrainingSettings
        from surrogate.storage.runs import with_chosen_splits

        with one_line_errors():
            scene = Scene.load(path)
            folder, in_place = scene.run_directory(runs), scene.source["kind"] == "catalog"
            place = scene.catalog_path if in_place else folder / "catalog.cdb"
            if not in_place and not place.is_dir():
                raise FileNotFoundError(
                    f"{place} does not exist yet: make it with `insitu dataset {path} --runs {runs}`"
                )
            catalog = Catalog.open(place)
        with scene_errors(scene.path):
            settings = TrainingSettings.from_table(scene.training)
            if in_place:
                hold_out = scene.source.get("hold_out")
                catalog = with_chosen_splits(catalog, settings, hold_out, scene.seed, folder)
        return cls(scene.name, settings, catalog, folder, path)

    @classmethod
    def _of_folder(cls, path: Path) -> OpenRun:
        from surrogate.storage.runs import RunFolder

        with one_line_errors():
            return cls.of_run(RunFolder.open(path))

    @classmethod
    def of_run(cls, run: RunFolder) -> OpenRun:
        """A run whose folder is open; raises as `RunFolder` does."""
        return cls(run.name, run.settings, run.catalog, run.folder, run.folder)

    @property
    def is_of_catalog(self) -> bool:
        """True if the run's folder names it, rather than a scene file."""
        return self.source.is_dir()

    @property
    def model(self) -> Path:
        """The folder of its surrogate."""
        return self.folder / "surrogate"

    def keep_record(self) -> None:
        """Let the run's folder say what it was trained on, as `surrogate.storage.runs` has it, where it does not yet."""
        from surrogate.storage.checkpoints import fingerprint
        from surrogate.storage.runs import RunRecord, path_between

        place, mark = path_between(self.folder, self.catalog.path), fingerprint(self.settings, self.catalog)
        with one_line_errors():
            record = RunRecord.load(self.folder)
            if record is None or (record.catalog, record.fingerprint) != (place, mark):
                RunRecord(place, self.settings.to_json(), self.catalog.splits, mark).save(self.folder)


def kind_of(path: Path) -> str:
    """The kind of a path, "scene", "catalog" or "run"; raises ClickException for anything else."""
    if path.is_dir():
        is_run = (path / "run.json").is_file() or (path / "surrogate").is_dir()
        return "catalog" if (path / "catalog.json").is_file() or (path.suffix == ".cdb" and not is_run) else "run"
    if path.suffix == ".toml":
        return "scene"
    what = "is neither a scene (a file FILE.toml), a catalog (a folder NAME.cdb) nor the folder of a run"
    raise click.ClickException(f"{path} {what if path.exists() else 'does not exist'}")


@contextlib.contextmanager
def scene_errors(path: Path) -> Iterator[None]:
    """Tell ValueError in one line that names the scene."""
    try:
        yield
    except ValueError as error:
        raise click.ClickException(f"scene {path}: {error}") from error


def assignment(text: str, names: Sequence[str]) -> tuple[str, str]:
    """Name and value of NAME=VALUE, of which one of `names` may hold a "=" or begin with a space; either may come out empty."""
    length = max((len(name) for name in names if text.startswith(f"{name}=")), default=-1)
    if length >= 0:
        return text[:length], text[length + 1 :].strip()
    name, _, value = (part.strip() for part in text.partition("="))
    return name, value


def load_surrogate(directory: Path) -> Surrogate:
    """The surrogate in a folder; raises ClickException where there is none, or none that can be read."""
    from surrogate.model import Surrogate

    try:
        return Surrogate.load(directory)
    except (FileNotFoundError, ValueError) as error:
        raise click.ClickException(str(error)) from error
