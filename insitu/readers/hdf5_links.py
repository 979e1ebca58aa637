"""Links in HDF5 files: none is followed, and data sets whose values lie elsewhere are read in the file's own folder alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py


def links(file: h5py.File) -> list[tuple[str, Any]]:
    """The path of every link to another file, or to another place in this one, and the link."""
    pairs: list[tuple[str, Any]] = []

    def visit(name: str, link: Any) -> None:  # which takes no exception
        if not isinstance(link, h5py.HardLink):
            pairs.append((name, link))

    file.visititems_links(visit)
    return pairs


def described_links(file: h5py.File) -> tuple[str, ...]:
    """Such as "rho to other.h5 /rho" for every link."""
    targets = {name: f"{getattr(link, 'filename', '')} {link.path}".strip() for name, link in links(file)}
    return tuple(f"{name} to {target}" for name, target in targets.items())


def check_inside(dataset: h5py.Dataset) -> None:
    """Raise ValueError where a data set's values lie in a file outside its own file's folder."""
    folder = Path(dataset.file.filename).resolve().parent
    names = [name for name, *_ in dataset.external or ()]
    names += [source.file_name for source in dataset.virtual_sources()] if dataset.is_virtual else []
    outside = [name for name in names if name != "." and not (folder / name).resolve().is_relative_to(folder)]
    if outside:
        raise ValueError(
            f"data set {dataset.name!r} reads {outside[0]}, which lies outside the file's folder: copy it there"
        )


def refuse_outside(file: h5py.File) -> None:
    """Raise ValueError where anything in the file leads to another one; readers other than ours would follow it."""
    sets: list[h5py.Dataset] = []
    file.visititems(lambda name, node: sets.append(node) if isinstance(node, h5py.Dataset) else None)
    for name, link in links(file):
        if isinstance(link, h5py.ExternalLink):
            raise ValueError(f"{name!r} is a link to {link.filename}: only what lies in the file itself is read")
    for dataset in sets:
        check_inside(dataset)
