"""The hook: render one member of an ensemble into a catalog, from anybody's simulation loop."""

from __future__ import annotations

import dataclasses
import inspect
import os
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from catalogs.store.catalog import Catalog
from catalogs.store.plan import CatalogError
from catalogs.vocabulary.appearance import Appearance
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.scene import NAN, ViewPlan
from catalogs.vocabulary.variations import Variation
from insitu.background.process import Background, members_held
from insitu.background.queue import queue_member
from insitu.fields.blocks import Blocks
from insitu.fields.boxes import Box
from insitu.fields.distances import member_distances
from insitu.fields.member_fields import MemberFields, as_fields, time_of
from insitu.fields.share import Ghosts
from insitu.members.agreement import agreeing_catalog, create_catalog, notes_on_member
from insitu.members.callers import warn_caller
from insitu.members.conflicts import EXISTING, Existing, stored_name, under_stored_name
from insitu.members.drawing import write_member
from insitu.members.failures import ON_ERROR, Failures, OnError, named_disk_errors, tell
from insitu.members.planning import (
    PlanOptions,
    Space,
    appearances_from,
    check_complete,
    measure_pilot,
    space_from,
    variations_from,
)
from insitu.members.request import MemberRequest, member_request, with_time
from insitu.members.result import PeakMemory, RenderedMember
from insitu.mpi.ranks import SINGLE, all_or_none, ranks_of, run_on_root
from render.datasets import ResamplingWarning

# What `render_member` hands on to the method of its name; the rest goes to `Session`.
OF_MEMBER = ("name", "split", "time", "spacing", "origin", "array", "dims", "ghosts")


class Session:
    """A catalog held open while the members of an ensemble arrive one at a time.

    The first member of a new catalog fixes what was left open: the cameras stand around `bounds`, or around that
    member's box; the sample distance is chosen on it.  Everything stays fixed from then on, in physical units:
    nothing is normalized per member.  With a catalog that exists (made earlier, or by another process meanwhile) every
    argument given must agree with it, else ValueError names the differences.

    A later member that reaches out of the ensemble's box is refused (ValueError): the cameras are not set for it.
    One that is smaller is rendered where it is, with a warning unless `bounds` were given, since spacing or origin may
    have been forgotten.

    Parameters are those of the function `render_member`; besides, `progress` is called with the number of images drawn of a
    member, and `warn` with each warning, which otherwise is given at the caller's line.  Use it as a context manager, from any
    thread.

    With `background=True` the loop does not wait for pictures: `render_member` checks what needs no look at the values, copies
    the field, and returns; another process renders.  Two members may be held then (`background=3`: three), which bounds the
    memory; one more waits until there is room.  What fails later, NaN for one, is a warning, and stands in `failures` when the
    session is closed, whatever `on_error` says; `results` has what was rendered.  No crash of the renderer reaches the loop: its
    member is tried once more.  Leaving the block waits for what is held, but after Ctrl-C.

    A restarted run renders what is missing with `existing="skip"`; a long run that must not end for a picture takes
    `on_error="warn"`.  What is wrong with the arguments of the session itself, or with the catalog that it finds, is raised at
    once all the same, before the run has begun; from then on nothing is, but KeyboardInterrupt and SystemExit.

    With `comm`, a communicator of mpi4py, the ranks of a simulation render their members together, each from its own block of the
    field: all make the session and call `render_member` and `has` in the same order, and get the same results and errors.  The
    catalog is that of rank 0, whose arguments hold, and which alone has `catalog`, `results` and `failures`.  A block comes with
    its spacing and the origin of its first sample; neighbours may both have the samples between them, or ghost layers.

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
        space: Space | None = None,
        appearances: Appearance | Iterable[Appearance] | None = None,
        views: ViewPlan | None = None,
        bounds: Box | None = None,
        target_decibels: float | None = None,
        sample_distance: float | Mapping[str, float] | None = None,
        image_format: str | None = None,
        provenance: Mapping[str, Any] | None = None,
        variations: Iterable[Variation] | None = None,
        fields: Mapping[str, Any] | None = None,
        nan: str = "refuse",
        existing: Existing = "error",
        on_error: OnError = "raise",
        background: bool | int = False,
        progress: Callable[[int], None] | None = None,
        warn: Callable[[Warning], None] | None = None,
        comm: Any = None,
    ) -> None:
        self.path, self._ranks = Path(catalog), ranks_of(comm)
        self._options = all_or_none(
            self._ranks,
            lambda: PlanOptions(
                space=space_from(space),
                appearances=appearances_from(appearances),
                views=views,
                bounds=bounds,
                target_decibels=target_decibels,
                sample_distance=sample_distance,
                image_format=image_format,
                provenance=provenance or {},
                variations=variations_from(variations),
                fields=fields or {},
            ),
        )
        self._nan = one_of(nan, NAN, "nan")
        self._existing, self._on_error = one_of(existing, EXISTING, "existing"), one_of(on_error, ON_ERROR, "on_error")
        self._progress, self._warn = progress or (lambda images: None), warn or warn_caller
        self._failures = Failures(self.path)
        self._said: set[tuple[str, str]] = set()
        self._catalog: Catalog | None = None
        run_on_root(self._ranks, self._find_catalog)
        self._results: list[RenderedMember] = []
        self._background = self._started(members_held(background))

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(at_once=kind is not None and issubclass(kind, KeyboardInterrupt))

    def __repr__(self) -> str:
        members = "not made yet" if self._catalog is None else f"{len(self._catalog.member_paths())} members"
        missing = f", {len(self.failures)} missing" if self.failures else ""
        return f"Session({str(self.path)!r}, {members}{missing})"

    @property
    def catalog(self) -> Catalog | None:
        """The catalog, or None before its first member."""
        return self._catalog

    @property
    def failures(self) -> Mapping[str, str]:
        """Why members that this session was to render are missing, by name; those that it rendered later are left out."""
        return self._failures.reasons

    def has(self, parameters: Mapping[str, float], *, time: float | None = None) -> bool:
        """Whether the catalog has a member with these parameters; with `existing="skip"` it would be skipped."""

        def found() -> bool:
            catalog = self._known_catalog()
            return catalog is not None and catalog.find(with_time(parameters, time, catalog.plan.space)[0]) is not None

        known: bool = run_on_root(self._ranks, found)
        return known

    @property
    def results(self) -> tuple[RenderedMember, ...]:
        """The members that this session has rendered so far, in their order, whether the loop waited for them or not."""
        if self._background is not None:
            self._background.take_results()
        return tuple(self._results)

    def close(self, *, at_once: bool = False) -> None:
        """Let go of the catalog, after what is rendered in the background, unless that is given up; `results` and `failures` are
        complete then.  The render window belongs to the process and serves the next session.
        """
        if self._background is not None:
            self._background.close(at_once=at_once)
        if self._catalog is not None:
            with suppress(OSError):  # a catalog that may only be read
                self._catalog.update_table()
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
        dims: Sequence[str] | None = None,
        ghosts: Ghosts = 0,
        nan: str | None = None,
        provenance: Mapping[str, Any] | None = None,
        appearances: Sequence[str] | None = None,
        existing: Existing | None = None,
        on_error: OnError | None = None,
    ) -> RenderedMember:
        """Render one member; arguments, result and errors as those of the function `render_member`.

        `appearances` names those of the catalog's that this member is shown with, all by default.  `nan`, `existing` and
        `on_error` are by default the session's.

        With `comm`, `field` is this rank's block, or None.  `ghosts` says how many layers around it are its neighbours': one number
        for every side, (x, y, z) numbers, or (x, y, z) pairs (before, after).  They are not shown, but help where blocks fill no
        grid and are resampled.
        """
        asked = {"name": name, "split": split, "provenance": provenance, "appearances": appearances}
        place: dict[str, Any] = {"spacing": spacing, "origin": origin, "array": array, "dims": dims}
        at = time_of(field) if time is None else time
        if self._ranks is SINGLE:
            if ghosts:
                raise ValueError(
                    f"ghosts={ghosts!r} are layers of a block: pass comm= to the session, or cut them away"
                )
            return self._render_member(
                field, parameters, at, existing, on_error, asked, {**place, "nan": nan or self._nan}
            )
        with Blocks(self._ranks, field, ghosts=ghosts, **place) as blocks:
            rendered: RenderedMember = run_on_root(
                self._ranks,
                lambda: self._render_member(
                    blocks, parameters, at, existing, on_error, asked, {"nan": nan or self._nan}
                ),
                blocks.commands,
            )
            return rendered

    def _render_member(
        self,
        field: Any,
        parameters: Mapping[str, float],
        time: float | None,
        existing: Existing | None,
        on_error: OnError | None,
        asked: Mapping[str, Any],
        place: Mapping[str, Any],
    ) -> RenderedMember:
        existing = one_of(existing or self._existing, EXISTING, "existing")
        on_error = one_of(on_error or self._on_error, ON_ERROR, "on_error")
        try:
            request = self.request(parameters, time=time, **asked)
            result = self._skipped(request, existing)
            if result is None and self._background is not None:
                return queue_member(
                    self._background, field, request, existing, self._catalog, self._known()[1], **place
                )
            result = result or self._render(field, request, existing, **place)
        except Exception as error:
            if on_error == "raise":
                raise
            return self._failures.add(asked["name"], parameters, error, self._warn)
        self._settled(result.name, parameters, result)
        return result

    def request(self, parameters: Mapping[str, float], **asked: Any) -> MemberRequest:
        """What is asked of one member, checked without its field: see `insitu.members.request.member_request`."""
        return member_request(*self._known(), parameters, **asked)

    def _known(self) -> tuple[ParameterSpace, Sequence[Appearance]]:
        catalog = self._known_catalog()
        return check_complete(self._options) if catalog is None else (catalog.plan.space, catalog.plan.appearances)

    def _known_catalog(self) -> Catalog | None:
        """The catalog, if there is one, be it that another process has made it meanwhile."""
        if self._catalog is None:
            self._find_catalog()
        return self._catalog

    def _find_catalog(self) -> None:
        self._catalog = agreeing_catalog(self.path, self._options)

    def _skipped(self, request: MemberRequest, existing: Existing) -> RenderedMember | None:
        """The result for a member that is there and may stay; None for one to render.  Raises where it must not be there."""
        catalog = self._known_catalog()
        name = None if catalog is None else stored_name(catalog, request, existing)
        return None if name is None else RenderedMember(name, self.path / "members" / name, skipped=True)

    def _render(self, field: Any, request: MemberRequest, existing: Existing, **place: Any) -> RenderedMember:
        """Render what is not there yet, or is to be replaced."""
        started, memory, replace = clock.perf_counter(), PeakMemory(), existing == "replace"
        _, known = self._known()
        needed = known if self._catalog is None else request.shown  # a new catalog's sample distances need all fields
        fields = _member_fields(field, needed, known, place)
        memory.sample()
        with named_disk_errors(request.name, self.path):
            catalog = self._catalog or self._created(fields)
            request = under_stored_name(catalog, request) if replace else request
            distances, coarse = member_distances(fields, request.shown, catalog.plan)
            notes = [*notes_on_member(fields.box, request.parameters, catalog.plan), *coarse]
            for note in [*map(ResamplingWarning, fields.notes), *map(UserWarning, notes)]:
                self._warn(note)
            warnings: tuple[str, ...] = (*fields.notes, *notes)
            record = {"bounds": fields.box, **({"sample_distances": distances} if coarse else {})}
            with catalog.begin_member(
                request.name,
                request.parameters,
                split=request.split,
                provenance={**request.record, **record},
                appearances=[appearance.name for appearance in request.shown],
                outside="allow",
                replace=replace,
            ) as writer:
                written, found = write_member(fields, request, distances, catalog.plan, writer, memory, self._progress)
                warnings = (*warnings, *map(str, found))
                if warnings:
                    writer.add_provenance(warnings=warnings)
        for picture in found:
            if picture[:2] not in self._said:  # once, whatever the numbers
                self._said.add(picture[:2])
                self._warn(UserWarning(str(picture)))
        return RenderedMember(
            name=request.name,
            path=catalog.path / "members" / request.name,
            **written,
            seconds=clock.perf_counter() - started,
            extra_memory=memory.extra_bytes,
            warnings=warnings,
        )

    def _started(self, held: int) -> Background | None:
        """The renderer of a session that does not wait, unless no member is held."""
        if not held:
            return None
        if self._ranks is not SINGLE:
            raise ValueError("background= and comm= can't be had together: every rank renders its own block")
        options = {option.name: getattr(self._options, option.name) for option in dataclasses.fields(self._options)}
        warn = partial(tell, warn=self._warn)
        options |= {"nan": self._nan}
        return Background(self.path, options, held, settled=self._settled, warn=warn, progress=self._progress)

    def _settled(self, name: str, parameters: Mapping[str, float], result: RenderedMember | str) -> None:
        """A member is there, rendered or skipped, or missing for the reason that is given."""
        if isinstance(result, str):
            self._failures.report(name, parameters, result, self._warn)
            return
        self._failures.forget(name)
        if not result.skipped:
            self._results.append(result)

    def _created(self, fields: MemberFields) -> Catalog:
        """The catalog, made for its first member's fields."""
        pilot = measure_pilot(fields, self._options)
        for note in pilot.notes:
            self._warn(UserWarning(note))
        self._catalog = create_catalog(self.path, pilot, self._options)
        self._failures.record()
        return self._catalog


def _member_fields(
    field: Any, needed: Sequence[Appearance], known: Sequence[Appearance], place: Mapping[str, Any]
) -> MemberFields:
    """What is shown of a member, here or on all ranks."""
    if isinstance(field, Blocks):
        return field.take(needed, known=known, **place)
    return as_fields(field() if callable(field) else field, needed, known=known, **place)


def one_of(value: Any, known: Sequence[str], what: str) -> Any:
    """`value`; raises ValueError naming what it is unless it is one of the known ones."""
    if value not in known:
        raise ValueError(f"{what} must be one of {tuple(known)}, got {value!r}")
    return value


def render_member(
    field: Any, parameters: Mapping[str, float], *, catalog: str | os.PathLike[str], **arguments: Any
) -> RenderedMember:
    """Render one member of an ensemble into a Cinema catalog; afterwards its field may go.

    The first call makes the catalog and fixes its plan; later calls, from this process or another, may leave the plan's
    arguments out, and must agree with the catalog where they state them.  A one-member `Session`.

    Parameters
    ----------
    field : numpy array (z, y, x), with `spacing`; a pyvista or VTK data set; or xarray's, taken by the names and coordinates
        of its axes; see `render.to_grid`.  Several fields are a mapping {name: array}, all of one shape, or a data set: every
        appearance then names its own, `field="..."`.  A function of no arguments that returns one of these is called only
        where the member is rendered.
    parameters : the member's simulation parameters by name, in the units of `space`.  A value out of bounds is
        rendered, with a warning that is also recorded.
    catalog : the `.cdb` directory.
    space : the ensemble's parameters, `{name: (low, high)}`, `{name: (low, high, unit)}`, `Parameter` objects, which have a
        scale too, or a `ParameterSpace`; needed by the first call.
    fields : what the shown field is called, and its unit, `{"Q": "1/s²"}`; of several, `{name: unit}` by the names that
        appearances give them, or `{name: Quantity(name, unit)}` where they are called otherwise.
    appearances : transfer functions and isovalues, in the field's physical units; needed by the first call.
    views : viewpoints and frame, by default 252 on the icosphere at 256 x 256 pixels.
    spacing, origin : of an array, (x, y, z), world units.
    array : which array of a data set, where appearances name no field.
    dims : what an array's axes are, in its own order: ("x", "y", "z") for values [x, y, z]; by default (z, y, x), or as
        xarray's are called.
    name : the member's name in the catalog, by default from its parameters.
    split : "train", "validation" or "test".
    nan : "refuse" NaN and infinity, or show them "transparent".
    target_decibels, sample_distance : how exact volume rendering must be, as PSNR against a converged reference (50 dB), or the
        step of its rays in world units, one for all or by appearance.
    time : the simulation's time, recorded.  Where `space` has a parameter "time" (or "t"), it is that: every dump of a run is
        a member.
    existing : what to do where the catalog has a member with these parameters: raise an "error", "skip" it, before the field is
        looked at, or "replace" it, atomically.
    on_error : "raise"; or "warn", and report the member missing (see `Session`).
    bounds : world box ((x, y, z), (x, y, z)) around which the cameras stand, by default the first member's.
    variations : which of the appearances sample an isovalue or a transfer function that is to be explored freely
        (`catalogs.vocabulary.variations.isovalue_family`, `transfer_function_family`), or are to be learnt beside a
        base (`field_variation`).
    image_format : "png" (8 bits, the default) or "exr" (float32).
    provenance : further JSON values to record in a new catalog.
    progress, warn : as in `Session`.
    comm, ghosts : of a field in blocks, one on each rank of an MPI communicator; see `Session` and its `render_member`.

    Memory: VTK and OpenGL take some 200 MB once; each call three times the field in float32 (the samples, the same scaled
    to the transfer function's range, and the texture), once each further field, and one image at a time.  Where float32 does not
    hold the field exactly, the samples take its own size: with float64 four times the field in float32.  Transparent values
    take three quarters of it more.  All of it is freed again but the first.

    Raises
    ------
    ValueError : the field, the parameters or the plan are not acceptable; nothing was written.
    OSError : the disk is full or not writable; nothing of the member was kept.
    """
    of_member = {name: arguments.pop(name) for name in OF_MEMBER if name in arguments}
    try:
        session = Session(catalog, **arguments)
    except (CatalogError, OSError) as error:  # of the catalog that is there; an argument's own mistake is always raised
        if arguments.get("on_error") != "warn":
            raise
        return Failures(Path(catalog)).add(
            of_member.get("name"), parameters, error, arguments.get("warn") or warn_caller
        )
    with session:
        return session.render_member(field, parameters, **of_member)


def _signature_of_hook() -> inspect.Signature:
    """The signature of `render_member`, its `**arguments` spelt out as `Session` and its method take them."""
    own = inspect.signature(render_member)
    of_session, of_member = (inspect.signature(f).parameters for f in (Session, Session.render_member))
    handed_on = [p for p in of_session.values() if p.name not in own.parameters] + [
        of_member[name] for name in OF_MEMBER
    ]
    named = [p for p in own.parameters.values() if p.kind is not inspect.Parameter.VAR_KEYWORD]
    return own.replace(parameters=[*named, *handed_on])


render_member.__signature__ = _signature_of_hook()  # type: ignore[attr-defined]
