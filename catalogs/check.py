"""Whether a Cinema database is what it says: every rule of specification D, and every image, one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from catalogs import cinema, durable
from catalogs.appearance import shown_fields
from catalogs.catalog import Catalog, CatalogError, Member
from catalogs.description import DESCRIPTION
from catalogs.images import ImageError, read_stored
from catalogs.members import ROWS, SUMMARY, read_record
from catalogs.png import PngError, check_png
from catalogs.table import MEMBERS, TABLE, derived_rows, rows_in

Progress = Callable[[int, int], None]
Shape = tuple[int, int, int]
IMAGES = {".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".webp"}
READERS = 2
REPAIR = "`catalogs check --repair` rebuilds the table"


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong: where (file, row, column) and what."""

    place: str
    problem: str

    def __str__(self) -> str:
        return f"{self.place}: {self.problem}"


def check(path: Path, *, progress: Progress = lambda done, total: None) -> list[Finding]:
    """Everything that is wrong with the Cinema database at `path`, whoever made it; empty where nothing is.

    The table is held to specification D (see `catalogs.cinema`); every image is decoded whole, once; where a `catalog.json`
    stands beside the table, members, rows, image sizes and summaries must agree with it too.  URLs are not fetched.
    """
    if not path.is_dir():
        return [Finding(str(path), "is no folder")]
    findings = [] if path.suffix == ".cdb" else [Finding(str(path), "a Cinema database's folder ends with .cdb")]
    header, rows, problems = _read_table(path)
    findings += problems
    shapes: dict[str, Shape] = {}
    if (path / DESCRIPTION).exists():
        findings += _check_catalog(path, shapes)
    return [*findings, *_check_files(path, _files(header, rows, shapes), shapes, progress)]


def _read_table(path: Path) -> tuple[list[str], list[list[str]], list[Finding]]:
    try:
        header, rows = cinema.parse(durable.read(path / TABLE).decode("utf-8"))
    except FileNotFoundError:
        return [], [], [Finding(TABLE, "is missing: it is the one file that every Cinema database has")]
    except durable.SpecialFileError as error:
        return [], [], [Finding(TABLE, str(error))]
    except (UnicodeDecodeError, cinema.TableError) as error:
        return [], [], [Finding(TABLE, str(error))]
    problems = [*cinema.header_problems(header), *cinema.column_problems(header, rows)]
    return header, rows, [Finding(TABLE, problem) for problem in problems]


def _files(header: Sequence[str], rows: Sequence[Sequence[str]], members: Iterable[str]) -> dict[str, str]:
    """What the table's cells name, and what the members must hold beside it: the places that say so, by file."""
    columns = [(i, label) for i, label in enumerate(header) if cinema.is_file_column(label)]
    named = {
        row[i]: f"{TABLE} row {number}, column {label}"
        for number, row in enumerate(rows, start=2)
        for i, label in columns
        if cinema.path_problem(row[i]) is None and not cinema.is_url(row[i])
    }
    return dict.fromkeys(members, "a member's image") | named


def _check_files(
    root: Path, files: Mapping[str, str], shapes: Mapping[str, Shape], progress: Progress
) -> Iterator[Finding]:
    with ThreadPoolExecutor(READERS) as pool:
        problems = pool.map(lambda name: _file_problem(root, name, shapes.get(name)), files)
        for done, ((name, place), problem) in enumerate(zip(files.items(), problems, strict=True), start=1):
            progress(done, len(files))
            if problem:
                yield Finding(place, f"{name} {problem}")


def _file_problem(root: Path, name: str, wanted: Shape | None) -> str | None:
    """What is wrong with a file, which must have the `wanted` height, width and channels where these are known."""
    path = root / name
    if not path.is_file():
        kind = durable.special(path)
        return f"is {kind}, where a file belongs" if kind else "is missing"
    if not path.resolve().is_relative_to(root.resolve()):
        return "is a link that leaves the database"
    try:
        shape = _read_shape(path)
    except (PngError, ImageError, OSError) as error:
        return f"is damaged: {error}"
    if shape is None:
        return None if path.stat().st_size else "is empty"
    if wanted is not None and shape != wanted:
        return f"is {_size(shape)}; its camera makes {_size(wanted)}"
    return None


def _read_shape(path: Path) -> Shape | None:
    """Height, width and channels of an image whose every byte was read; None for a file that is no image."""
    if path.suffix.lower() == ".png":
        header = check_png(path)
        if header.is_plain_color:
            return header.height, header.width, 4 if header.has_alpha else 3
    if path.suffix.lower() not in {".png", *IMAGES}:
        return None
    height, width, channels = read_stored(path).shape
    return height, width, channels


def _size(shape: Shape) -> str:
    height, width, channels = shape
    return f"{width}x{height} with {channels} channels"


def _check_catalog(path: Path, shapes: dict[str, Shape]) -> Iterator[Finding]:
    """What is wrong with `catalog.json` and the members; fills in the `shapes` that their images must have."""
    try:
        catalog = Catalog.open(path)
    except CatalogError as error:
        yield Finding("catalog.json", str(error))
        return
    if (path / MEMBERS).is_dir():
        strays = {p for p in (path / MEMBERS).iterdir() if not p.name.startswith(".")} - set(catalog.member_paths())
        yield from (Finding(f"{MEMBERS}/{p.name}", "is no member: it holds no member.json") for p in sorted(strays))
    members = []
    for folder in catalog.member_paths():
        try:
            members.append(read_record(folder, catalog.plan))
        except CatalogError as error:
            yield Finding(f"member {folder.name}", str(error))
    for member in members:
        yield from _check_member(catalog, member)
        for appearance in member.appearances:
            for view, camera in enumerate(member.cameras):
                name = catalog.image_path(member, appearance, view).relative_to(path).as_posix()
                shapes[name] = (camera.height, camera.width, 4)
    yield from _check_duplicates(members)
    yield from _check_table(catalog)


def _check_member(catalog: Catalog, member: Member) -> Iterator[Finding]:
    yield from _check_summaries(catalog, member)
    try:
        if durable.read(member.path / ROWS) == derived_rows(member, catalog.plan):
            return
        problem = f"{ROWS} is not what its member.json and the catalog's plan make"
    except FileNotFoundError:
        problem = f"{ROWS} is missing"
    except OSError as error:
        problem = str(error)
    yield Finding(f"member {member.name}", f"{problem}: `catalogs check --repair` writes it anew")


def _check_summaries(catalog: Catalog, member: Member) -> Iterator[Finding]:
    """Whether the sidecar can be read and, where a catalog shows several fields, is of exactly those that the member shows."""
    try:
        kept = member.summaries()
    except ValueError as error:
        yield Finding(f"member {member.name}", str(error))
        return
    shown = shown_fields(a for a in catalog.plan.appearances if a.name in set(member.appearances))
    if not kept or len(catalog.plan.fields) < 2 or set(kept) == set(shown):
        return
    yield Finding(f"member {member.name}", f"{SUMMARY} is of the fields {list(kept)}, the pictures of {list(shown)}")


def _check_duplicates(members: Iterable[Member]) -> Iterator[Finding]:
    first: dict[tuple[float, ...], str] = {}
    for member in members:
        other = first.setdefault(tuple(member.parameters.values()), member.name)
        if other != member.name:
            yield Finding(f"member {member.name}", f"has the parameters of member {other}")


def _check_table(catalog: Catalog) -> Iterator[Finding]:
    """Whether the table is what the members make, in any order: which of them it lacks or invents, and else where it differs."""
    try:
        header, rows = cinema.parse(durable.read(catalog.path / TABLE).decode())
        wanted = {path.name: cinema.parse(rows_in(path, catalog.plan).decode()) for path in catalog.member_paths()}
    except (OSError, ValueError):
        return  # told already
    labels = catalog.plan.header
    if labels != header:
        yield Finding(TABLE, f"has the columns {header}, the catalog makes {labels}: {REPAIR}")
        return
    column = header.index("member")
    named = dict.fromkeys(row[column] for row in rows)
    for name in sorted(named.keys() ^ wanted.keys()):
        where = "stored but not in the table" if name in wanted else "in the table but not stored"
        yield Finding(f"member {name}", f"is {where}: {REPAIR}")
    if named.keys() != wanted.keys():
        return
    cells = [row for name in named for row in (wanted[name][0], *wanted[name][1])]
    if cells != rows:
        number = next((n for n, (a, b) in enumerate(zip(rows, cells, strict=False), start=2) if a != b), None)
        where = f"{len(rows)} rows instead of {len(cells)}" if number is None else f"row {number} and maybe others"
        yield Finding(TABLE, f"differs from what the members make ({where}): {REPAIR}")
