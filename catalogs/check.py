"""Whether a Cinema database is what it says: every rule of specification D, and every image, one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from catalogs import cinema
from catalogs.catalog import Catalog, CatalogError, Member
from catalogs.images import ImageError, image_shape, read_image

Progress = Callable[[int, int], None]
IMAGES = {".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".webp"}


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong: where (file, row, column) and what."""

    place: str
    problem: str

    def __str__(self) -> str:
        return f"{self.place}: {self.problem}"


def check(path: Path, *, progress: Progress = lambda done, total: None) -> list[Finding]:
    """Everything that is wrong with the database at `path`, ours or anybody's; empty when nothing is.

    The table is held to specification D; every image is decoded whole; where a `catalog.json` stands beside the table,
    members, sizes and summaries must agree with it too.
    """
    if not path.is_dir():
        return [Finding(str(path), "is no folder")]
    findings = [] if path.suffix == ".cdb" else [Finding(str(path), "a Cinema database's folder ends with .cdb")]
    table = path / "data.csv"
    if not table.is_file():
        return [*findings, Finding(str(table), "is missing: it is the one file that every Cinema database has")]
    try:
        header, rows = cinema.parse(table.read_bytes().decode("utf-8"))
    except (UnicodeDecodeError, cinema.TableError) as error:
        return [*findings, Finding("data.csv", str(error))]
    problems = [*cinema.header_problems(header), *cinema.column_problems(header, rows)]
    findings += [Finding("data.csv", problem) for problem in problems]
    findings += _check_files(path, header, rows, progress)
    if (path / "catalog.json").is_file():
        findings += _check_catalog(path, header, rows)
    return findings


def _check_files(
    path: Path, header: Sequence[str], rows: Sequence[Sequence[str]], progress: Progress
) -> Iterator[Finding]:
    columns = [i for i, label in enumerate(header) if cinema.is_file_column(label)]
    cells = [(number, header[i], row[i]) for number, row in enumerate(rows, start=2) for i in columns]
    cells = [cell for cell in cells if cinema.path_problem(cell[2]) is None]

    def problem(cell: tuple[int, str, str]) -> str | None:
        return _file_problem(path, path / cell[2])

    with ThreadPoolExecutor(2) as pool:
        for done, (cell, found) in enumerate(zip(cells, pool.map(problem, cells), strict=True), start=1):
            progress(done, len(cells))
            if found:
                yield Finding(f"data.csv row {cell[0]}, column {cell[1]}", found)


def _file_problem(root: Path, file: Path) -> str | None:
    if not file.is_file():
        return f"{file.relative_to(root)} is missing"
    if not file.resolve().is_relative_to(root.resolve()):
        return f"{file.relative_to(root)} is a link that leaves the database"
    if file.suffix.lower() not in IMAGES:
        return None if file.stat().st_size else f"{file.relative_to(root)} is empty"
    try:
        read_image(file)
    except ImageError as error:
        return str(error)
    return None


def _check_catalog(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[Finding]:
    try:
        catalog = Catalog.open(path)
        members = catalog.members
    except (CatalogError, ValueError) as error:
        yield Finding("catalog.json", str(error))
        return
    named = {row[header.index("member")] for row in rows} if "member" in header else set()
    for name in sorted(named ^ {m.name for m in members}):
        where = "in the table but not stored" if name in named else "stored but not in the table"
        yield Finding(f"member {name}", f"is {where}: `catalogs check --repair` rebuilds the table")
    images = sum(len(m.cameras) for m in members) * len(catalog.appearance_names)
    if not named ^ {m.name for m in members} and len(rows) != images:
        yield Finding("data.csv", f"has {len(rows)} rows, the members {images} images")
    for member in members:
        yield from _check_member(catalog, member)


def _check_member(catalog: Catalog, member: Member) -> Iterator[Finding]:
    for appearance in catalog.appearance_names:
        for view, camera in enumerate(member.cameras):
            file = catalog.image_path(member, appearance, view)
            try:
                height, width, channels = image_shape(file)
            except ImageError:
                continue  # told already, row by row
            if (width, height, channels) != (camera.width, camera.height, 4):
                yield Finding(
                    str(file.relative_to(catalog.path)),
                    f"is {width}x{height} with {channels} channels; its camera makes {camera.width}x{camera.height} RGBA",
                )
    try:
        member.summary()
    except ValueError as error:
        yield Finding(f"member {member.name}", str(error))


def describe(path: Path) -> str:
    """What is in a catalog, as a table for people.  Raises CatalogError where `path` is none."""
    catalog = Catalog.open(path)
    members = catalog.members
    plan = catalog.plan
    lines = [repr(catalog)]
    if members:
        first = members[0].cameras[0]
        size = sum(f.stat().st_size for f in path.rglob("*") if f.is_file())
        images = sum(len(m.cameras) for m in members) * len(plan.appearances)
        alpha = "RGBA" if plan.background is None else f"opaque on {plan.background}"
        lines += [
            f"  images      {images:,} of {first.width}x{first.height}, {plan.image_format}, {alpha}, {size / 1e6:.1f} MB",
            f"  box         {plan.bounds[0]} to {plan.bounds[1]}",
            "",
        ]
        lines += _member_table(catalog, members)
    return "\n".join(lines)


def _member_table(catalog: Catalog, members: Sequence[Member]) -> list[str]:
    names = catalog.plan.space.names
    rows = [["member", "split", *names, "views", "minimum", "maximum", "clipped"]]
    for member in members:
        summary = member.summary()
        kept = (
            ["–"] * 3
            if summary is None
            else [f"{summary.minimum:.5g}", f"{summary.maximum:.5g}", f"{100 * summary.clipped_fraction:.2f} %"]
        )
        values = [f"{member.parameters[n]:g}" for n in names]
        rows.append([member.name, member.split, *values, str(len(member.cameras)), *kept])
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return ["  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]
