"""The hook: render one member of an ensemble into a catalog, from anybody's simulation loop."""

from __future__ import annotations

import hashlib
import os
import time as clock
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from catalogs.appearance import Appearance, VolumeRendering, field_of, shown_fields
from catalogs.catalog import Catalog, CatalogPlan, MemberWriter
from catalogs.members import known_appearances
from catalogs.parameters import SPLITS, ParameterSpace
from catalogs.plan import CatalogError, json_values, name_problem
from catalogs.scene import ViewPlan
from catalogs.summary import FieldSummary
from catalogs.variations import Variation
from insitu.boxes import Box, box_of, check_inside, shrunken
from insitu.fields import Fields, as_fields
from insitu.memory import PeakMemory
from insitu.planning import (
    Wishes,
    appearances_from,
    check_agreement,
    check_complete,
    is_catalog,
    measure_pilot,
    plan_catalog,
    space_from,
    value_range_of,
)
from insitu.rendered import RenderedMember
from insitu.summarize import summarize

if TYPE_CHECKING:
    from render.grids import Grid

LONGEST_NAME = 80


class Session:
    """A catalog held open while the members of an ensemble arrive one at a time.

    The first member of a new catalog fixes what was left open: the cameras stand around `bounds`, or around that
    member's box; the sample distance is chosen on it.  Everything stays fixed from then on, in physical units:
    nothing is normalized per member.  With a catalog that exists (made earlier, or by another process meanwhile) every
    argument given must agree with it, else ValueError names the differences.

    A later member that reaches out of the ensemble's box is refused (ValueError): the cameras are not set for it.
    One that is smaller is rendered where it is, with a warning unless `bounds` were given, since spacing or origin may
    have been forgotten.

    Use it as a context manager.  Parameters are those of `render_member` and of `insitu.planning.Wishes`.

    Examples
    --------
    >>> with insitu.Session("tgv.cdb", space={"Re": (1500, 2500)}, appearances=[volume]) as session:  # doctest: +SKIP
    ...     for reynolds in (1500, 2000, 2500):
    ...         print(session.render_member(simulate(reynolds), {"Re": reynolds}, spacing=(dx, dx, dx)))
    """

    def __init__(
        self,
        catalog: str | os.PathLike[str],
        *,
        space: ParameterSpace | Mapping[str, tuple[float, float]] | None = None,
        appearances: Appearance | Iterable[Appearance] | None = None,
        views: ViewPlan | None = None,
        bounds: Box | None = None,
        target_decibels: float | None = None,
        sample_distance: float | Mapping[str, float] | None = None,
        image_format: str | None = None,
        provenance: Mapping[str, Any] | None = None,
        variations: Iterable[Variation] | None = None,
        nan: str = "refuse",
        progress: Callable[[int], None] | None = None,
    ) -> None:
        self.path = Path(catalog)
        self._wishes = Wishes(
            space=space_from(space),
            appearances=appearances_from(appearances),
            views=views,
            bounds=bounds,
            target_decibels=target_decibels,
            sample_distance=sample_distance,
            image_format=image_format,
            provenance=provenance or {},
            variations=None if variations is None else tuple(variations),
        )
        self._nan = nan
        self._progress = progress
        self._catalog = self._opened() if is_catalog(self.path) else None

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Session({str(self.path)!r}, {'not made yet' if self._catalog is None else self._catalog!r})"

    @property
    def catalog(self) -> Catalog | None:
        """The catalog, or None before its first member."""
        return self._catalog

    def close(self) -> None:
        """Let go of the catalog; the render window belongs to the process and serves the next session."""
        self._catalog = None

    def render_member(
        self,
        field: Any,
        parameters: Mapping[str, float],
        *,
        name: str | None = None,
        split: str = "train",
        time: float | None = None,
        spacing: Sequence[float] | None = None,
        origin: Sequence[float] | None = None,
        array: str | None = None,
        nan: str | None = None,
        provenance: Mapping[str, Any] | None = None,
        appearances: Sequence[str] | None = None,
    ) -> RenderedMember:
        """Render one member; arguments, result and errors as those of the function `render_member`.

        `appearances` names those of the catalog's that this member is shown with, all by default.
        """
        started, memory = clock.perf_counter(), PeakMemory()
        if split not in SPLITS:
            raise ValueError(f"split must be one of {SPLITS}, got {split!r}")
        self._check_parameters(parameters)
        known, shown = self._known_and_shown(appearances)
        looked_at = shown if self._catalog else known  # a new catalog's sample distances need all fields
        name = name or member_name(parameters)
        recorded = _recorded(name, provenance, time)
        with _repeated_warnings() as resampled:
            fields = as_fields(
                field, looked_at, known=known, spacing=spacing, origin=origin, array=array, nan=nan or self._nan
            )
        memory.sample()
        with _named_disk_errors(name, self.path):
            catalog = self._catalog = self._catalog or self._created(fields)
            check_inside(fields.first, catalog.plan.bounds)
            notes = _notes(fields.first, parameters, catalog)
            for note in notes:
                warnings.warn(note, stacklevel=2)
            recorded["bounds"] = box_of(fields.first)
            if resampled or notes:
                recorded["warnings"] = [*resampled, *notes]
            of_shown = [a.name for a in shown]
            with catalog.begin_member(  # out of bounds is already said and recorded
                name, parameters, split=split, provenance=recorded, appearances=of_shown, outside="allow"
            ) as writer:
                drawn = self._draw(fields, catalog, writer, memory)
                summaries = _summaries(fields, shown, catalog.plan)
                memory.sample()
                if len(catalog.plan.fields) > 1:
                    writer.write_summaries(summaries)
                else:
                    writer.write_summary(next(iter(summaries.values())))
        return RenderedMember(
            name=name,
            path=catalog.path / "members" / name,
            images=drawn.images,
            render_seconds=drawn.render,
            write_seconds=drawn.write,
            seconds=clock.perf_counter() - started,
            extra_memory=memory.extra_bytes,
            ranges={name: (kept.minimum, kept.maximum) for name, kept in summaries.items()},
            clipped_fractions={name: kept.clipped_fraction for name, kept in summaries.items()},
            warnings=(*resampled, *notes),
        )

    def _opened(self) -> Catalog:
        catalog = Catalog.open(self.path)
        check_agreement(catalog, self._wishes)
        return catalog

    def _created(self, fields: Fields) -> Catalog:
        plan = plan_catalog(measure_pilot(fields, self._wishes), self._wishes)
        try:
            return Catalog.create(self.path, plan)
        except (ValueError, FileExistsError):
            if not is_catalog(self.path):
                raise
            return self._opened()  # another process was first: its plan holds, if the arguments agree with it

    def _check_parameters(self, parameters: Mapping[str, float]) -> None:
        """Refuse wrong names before the field is looked at; the catalog refuses duplicates."""
        space = self._catalog.plan.space if self._catalog else self._wishes.space
        if space is not None:  # else a new catalog lacks it: plan_catalog says so
            space.values(parameters, outside="allow")

    def _known_and_shown(self, names: Sequence[str] | None) -> tuple[Sequence[Appearance], Sequence[Appearance]]:
        """All appearances, and those of a member; refuses unknown names before a new catalog is made for them."""
        known = self._catalog.plan.appearances if self._catalog else check_complete(self._wishes)[1]
        wanted = set(known_appearances(names, [a.name for a in known]))
        return known, [a for a in known if a.name in wanted]

    def _draw(self, fields: Fields, catalog: Catalog, writer: MemberWriter, memory: PeakMemory) -> _Drawn:
        """Render every appearance from every view, one image in memory at a time."""
        from render import render_views

        render, write, images = 0.0, 0.0, 0
        distances = catalog.plan.provenance.get("sample_distances", {})
        shown = set(writer.member.appearances)
        for appearance in (a for a in catalog.plan.appearances if a.name in shown):
            distance = distances.get(appearance.name) if isinstance(appearance, VolumeRendering) else None
            exact = catalog.plan.image_format == "exr"
            before = clock.perf_counter()
            pictures = render_views(
                fields.shown_by(appearance),
                appearance,
                catalog.plan.cameras,
                sample_distance=distance,
                float_output=exact,
            )
            for view, rgba in enumerate(pictures):
                between = clock.perf_counter()
                writer.write_image(appearance.name, view, rgba)
                after = clock.perf_counter()
                render, write, images = render + between - before, write + after - between, images + 1
                memory.sample()
                if self._progress is not None:
                    self._progress(images)
                before = clock.perf_counter()
        return _Drawn(render, write, images)


def render_member(
    field: Any,
    parameters: Mapping[str, float],
    *,
    catalog: str | os.PathLike[str],
    space: ParameterSpace | Mapping[str, tuple[float, float]] | None = None,
    appearances: Appearance | Iterable[Appearance] | None = None,
    views: ViewPlan | None = None,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    array: str | None = None,
    name: str | None = None,
    split: str = "train",
    nan: str = "refuse",
    target_decibels: float | None = None,
    sample_distance: float | Mapping[str, float] | None = None,
    time: float | None = None,
    bounds: Box | None = None,
    variations: Iterable[Variation] | None = None,
) -> RenderedMember:
    """Render one member of an ensemble into a Cinema catalog; afterwards its field may go.

    The first call makes the catalog and fixes its plan; later calls, from this process or another, may leave the plan's
    arguments out, and must agree with the catalog where they state them.  A one-member `Session`.

    Parameters
    ----------
    field : numpy array (z, y, x), with `spacing`; or a pyvista or VTK data set; see `insitu.adapters.as_grid`.  Several fields are
        a mapping {name: array}, all of one shape, or a data set: every appearance then names its own, `field="..."`.
    parameters : the member's simulation parameters by name, in the units of `space`.  A value out of bounds is
        rendered, with a warning that is also recorded.
    catalog : the `.cdb` directory.
    space : the ensemble's parameters, `ParameterSpace` or `{name: (low, high)}`; needed by the first call.
    appearances : transfer functions and isovalues, in the field's physical units; needed by the first call.
    views : viewpoints and frame, by default 252 on the icosphere at 256 x 256 pixels.
    spacing, origin : of an array, (x, y, z), world units.
    array : which array of a data set, where appearances name no field.
    name : the member's name in the catalog, by default from its parameters.
    split : "train", "validation" or "test".
    nan : "refuse" NaN and infinity, or show them "transparent".
    target_decibels, sample_distance : how exact volume rendering must be (50 dB), or its step in world units.
    time : the simulation's time, recorded.
    bounds : world box ((x, y, z), (x, y, z)) around which the cameras stand, by default the first member's.
    variations : which of the appearances sample an isovalue or a transfer function that is to be explored freely
        (`catalogs.variations.isovalue_family`, `transfer_function_family`), or are to be learnt beside a base (`field_variation`).

    Memory: VTK and OpenGL take some 200 MB once; each call three times the field in float32 (the samples, the same scaled
    to the transfer function's range, and the texture), once each further field, and one image at a time.  All of it is freed again
    but the first.

    Raises
    ------
    ValueError : the field, the parameters or the plan are not acceptable; nothing was written.
    OSError : the disk is full or not writable; nothing of the member was kept.
    """
    with Session(
        catalog,
        space=space,
        appearances=appearances,
        views=views,
        bounds=bounds,
        target_decibels=target_decibels,
        sample_distance=sample_distance,
        variations=variations,
        nan=nan,
    ) as session:
        return session.render_member(
            field, parameters, name=name, split=split, time=time, spacing=spacing, origin=origin, array=array
        )


def member_name(parameters: Mapping[str, float]) -> str:
    """A member's default name: its parameters, or their digest where that would be long or no name."""
    text = "_".join(f"{name}-{float(value)!r}" for name, value in parameters.items())
    text = "".join(c if c.isalnum() or c in "-_." else "-" for c in text)
    fits = len(text) <= LONGEST_NAME and name_problem(text) is None
    return text if fits else "member-" + hashlib.sha256(text.encode()).hexdigest()[:12]


@dataclass(frozen=True)
class _Drawn:
    render: float
    write: float
    images: int


def _recorded(name: str, provenance: Mapping[str, Any] | None, time: float | None) -> dict[str, Any]:
    """What a member's record says by itself; refuses what no catalog takes before a new one is made for it."""
    problem = name_problem(name)
    if problem:
        raise CatalogError(f"a member can't be called so: {problem}")
    told = {**(provenance or {}), **({} if time is None else {"time": float(time)})}
    return json_values(told, f"the provenance of member {name}")


def _summaries(fields: Fields, shown: Sequence[Appearance], plan: CatalogPlan) -> dict[str, FieldSummary]:
    """What is kept of each field that a member shows, by name, under all of the catalog's appearances of it."""
    sampled = _sampled(plan)
    return {
        field: summarize(fields.grids[field], [a for a in sampled if field_of(a) == field], value_range_of(plan, field))
        for field in shown_fields(shown)
    }


def _sampled(plan: CatalogPlan) -> tuple[Appearance, ...]:
    """The appearances by which points of the field are kept: of transfer functions only the bases, whose places all share."""
    same = {n for v in plan.variations if v.edits_base for n in v.named(*SPLITS)}
    return tuple(a for a in plan.appearances if a.name not in same)


@contextmanager
def _repeated_warnings() -> Iterator[list[str]]:
    """Yields a list that holds, after the block, what it warned of; the warnings are given on."""
    messages: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield messages
    for warning in caught:
        messages.append(str(warning.message))
        warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)


@contextmanager
def _named_disk_errors(name: str, path: Path) -> Iterator[None]:
    """Adds member and remedy to an OSError on its way out."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(
            error.errno,
            f"{error.strerror}: member {name} could not be stored and nothing of it was kept; "
            "make room or permission, then render it again",
            str(path),
        ) from error


def _notes(grid: Grid, parameters: Mapping[str, float], catalog: Catalog) -> list[str]:
    """What deserves a warning about this member."""
    space = catalog.plan.space
    notes = list(space.outside([float(parameters[name]) for name in space.names]).values())
    if catalog.plan.provenance.get("bounds_from") != "given" and shrunken(grid, catalog.plan.bounds):
        notes.append(
            f"the member's box {box_of(grid)} is not the first member's {catalog.plan.bounds}, around which the "
            "cameras stand: check spacing and origin"
        )
    return notes
