"""Checks of a new catalog before anything is simulated, read or drawn for it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from catalogs.files.durable import require_writable
from catalogs.store.description import check_place
from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.appearance import Appearance, Isosurface, shown_fields
from catalogs.vocabulary.scene import ViewPlan
from insitu.members.planning import Pilot, PlanOptions, check_complete, check_steps, plan_catalog

ANY_SIDE = 4096  # pixels: what every OpenGL draws
UNIT_BOX = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)


def check_new(path: Path, options: PlanOptions) -> None:
    """Raise ValueError or OSError where no catalog of these options can be made at `path`, whatever its members hold.

    All that is checked is known without a field: that the options are complete and agree, and that the folder can be written.
    """
    _, appearances = check_complete(options)
    ranges = dict.fromkeys(shown_fields(appearances), (0.0, 1.0))
    plan = plan_catalog(Pilot(options.bounds or UNIT_BOX, ranges), options)
    plan.check_recordable()
    if options.bounds is not None:
        check_steps(options.sample_distance, options.bounds)
    check_free(path, plan)
    views = options.views or ViewPlan()
    if 2 * max(views.width, views.height) > ANY_SIDE:
        from render.views import check_sizes

        by_vtk = {"vtk": appearances, "cpu": ()}.get(options.backend, _surfaces(appearances))
        check_sizes(by_vtk, plan.cameras[:1])


def _surfaces(appearances: Sequence[Appearance]) -> list[Appearance]:
    return [a for a in appearances if isinstance(a, Isosurface)]


def check_free(path: Path, plan: CatalogPlan | None = None) -> None:
    """Raise CatalogError or OSError where no new catalog can be at `path`, of this plan if it is known."""
    check_place(path, plan)
    require_writable(path, "no catalog can be written here, choose another folder, or make room or permission")


def checked_path(catalog: Any) -> Path:
    """The catalog's path; raises ValueError for anything else."""
    try:
        return Path(catalog)
    except TypeError:
        raise ValueError(f"catalog must be the path of a .cdb folder, got {catalog!r}") from None


def checked_function(function: Any, name: str) -> Any:
    """A function or None; raises ValueError for anything else."""
    if function is not None and not callable(function):
        raise ValueError(f"{name} must be a function, got {function!r}")
    return function
