"""A catalog open over many members: `Session`, the hook for simulation loops."""

from __future__ import annotations

import os
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
from catalogs.vocabulary.words import plural
from insitu.background.process import Background, queue_length
from insitu.background.queue import queue_member
from insitu.fields.blocks import Blocks
from insitu.fields.boxes import Box
from insitu.fields.location import FieldLocation, Ghosts
from insitu.fields.member_fields import LocalField, MemberInput, time_of
from insitu.fields.share import ghost_layers
from insitu.hook.traps import no_traps
from insitu.hook.writer import CatalogWriter
from insitu.members.beginning import check_new, checked_function, checked_path
from insitu.members.failures import Failures, called, warn_caller, warn_safely
from insitu.members.notes import notes_on_catalog
from insitu.members.planning import PlanOptions, Space, appearances_from, space_from, variations_from
from insitu.members.request import EXISTING, ON_ERROR, Existing, MemberArguments, OnError, one_of, with_time
from insitu.members.result import RenderedMember
from insitu.mpi.ranks import SINGLE, all_or_none, disagreement, ranks_of, run_on_root


class Session:
    """A catalog that stays open while the members of an ensemble arrive one at a time.

    The first member of a new catalog fixes what was left open: the cameras surround `bounds`, or that member's box; the sample
    distance is chosen on it.  Everything stays fixed from then on, in physical units: nothing is normalized per member.  With an
    existing catalog (made earlier, or by another process meanwhile) every argument given must agree with it, else ValueError
    names the differences.

    A later member that reaches out of the ensemble's box is refused (ValueError): the cameras are not set for it.  A smaller one
    is rendered where it is, with a warning unless `bounds` were given, since spacing or origin may have been forgotten.

    Parameters are those of the function `render_member`.  `progress` is called with the number of images drawn of a member, and
    `warn` with each warning, which otherwise is given at the caller's line.  Use it as a context manager, from any thread.

    With `background=True` the loop does not wait for images: `render_member` checks what needs no look at the values, copies the
    field, and returns; another process renders.  At most two members are queued (`background=3`: three); after that the call
    blocks.  Later failures, such as NaN, become warnings and entries of `failures`, whatever `on_error` says; `results` lists what
    was rendered.  A renderer crash cannot stop the loop: its member is tried once more.  Leaving the block waits for the queue,
    except after Ctrl-C.

    A restarted run renders only missing members with `existing="skip"`; a long run that must not end because of an image takes
    `on_error="warn"`.  Mistakes in the session's own arguments, or a catalog that disagrees with them, are raised at once all the
    same, before the run has begun.  Later only KeyboardInterrupt and SystemExit are.

    With `comm`, a communicator of mpi4py, the ranks of a simulation render their members together, each from its own block of the
    field.  All make the session and call `render_member` and `has` in the same order, and get the same results and errors.  The
    catalog is that of rank 0, whose arguments count, and which alone has `catalog`, `results` and `failures`.  A block comes with
    its spacing and the origin of its first sample; neighbours may both have the samples between them, or ghost layers.

    Examples
    --------
    >>> import insitu
    >>> from blobs import APPEARANCE, PLACE, simulate
    >>> views = insitu.ViewPlan(frequency=1, width=32, height=32)
    >>> plan = {"space": {"separation": (0.6, 1.0)}, "appearances": APPEARANCE, "views": views}
    >>> with insitu.Session("blobs.cdb", **plan, existing="skip", on_error="warn") as session:
    ...     for separation in (0.6, 0.7, 0.8, 1.0):  # your loop
    ...         member = session.render_member(simulate(separation, 0.3), {"separation": separation}, **PLACE)
    >>> sum(member.images for member in session.results)
    48
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
        coarse_field: bool = True,
        backend: str = "auto",
        nan: str = "refuse",
        existing: Existing = "error",
        on_error: OnError = "raise",
        background: bool | int = False,
        progress: Callable[[int], None] | None = None,
        warn: Callable[[Warning], None] | None = None,
        comm: Any = None,
    ) -> None:
        self._ranks = ranks_of(comm)

        def checked() -> tuple[Path, int, PlanOptions]:
            one_of(nan, NAN, "nan"), one_of(existing, EXISTING, "existing"), one_of(on_error, ON_ERROR, "on_error")
            checked_function(progress, "progress"), checked_function(warn, "warn")
            length = queue_length(background)
            if length and self._ranks is not SINGLE:
                raise ValueError("background= and comm= can't be combined: every rank renders its own block")
            if backend == "cpu" and self._ranks is not SINGLE:
                raise ValueError("backend='cpu' draws whole fields; blocks of several ranks are drawn by VTK")
            plan = PlanOptions(
                space=space_from(space),
                appearances=appearances_from(appearances),
                views=views,
                bounds=bounds,
                target_decibels=target_decibels,
                sample_distance=sample_distance,
                image_format=image_format,
                provenance={} if provenance is None else provenance,
                variations=variations_from(variations),
                fields=fields or {},
                coarse_field=coarse_field,
                backend=backend,
            )
            return checked_path(catalog), length, plan

        self.path, length, options = all_or_none(self._ranks, checked)
        self._nan, self._existing, self._on_error = nan, existing, on_error
        self._warn, self._failures = warn or warn_caller, Failures(self.path)
        progress = progress or (lambda images: None)
        self._writer = CatalogWriter(
            self.path, options, progress=progress, warn=self._warn, created=self._failures.record
        )
        run_on_root(self._ranks, lambda: None if self._writer.find_catalog() else check_new(self.path, options))
        self._results: list[RenderedMember] = []
        self._background = self._start_background(length, options, progress)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(at_once=kind is not None and issubclass(kind, KeyboardInterrupt))

    def __repr__(self) -> str:
        members = "not made yet" if self.catalog is None else plural(len(self.catalog.member_paths()), "member")
        missing = f", {len(self.failures)} missing" if self.failures else ""
        return f"Session({str(self.path)!r}, {members}{missing})"

    @property
    def catalog(self) -> Catalog | None:
        """The catalog, or None before its first member."""
        return self._writer.catalog

    @property
    def failures(self) -> Mapping[str, str]:
        """The reasons, by name, for members of this session that are missing; those rendered later are left out."""
        return self._failures.reasons

    def has(self, parameters: Mapping[str, float], *, time: float | None = None) -> bool:
        """True if the catalog has a member with these parameters; with `existing="skip"` it would be skipped."""
        problem = disagreement(self._ranks, {"parameters": parameters, "time": time})

        def is_stored() -> bool:
            if problem:
                raise ValueError(problem)
            catalog = self._writer.find_catalog()
            if self._space is None:
                return False
            wanted, _ = with_time(parameters, time, self._space)
            self._space.values(wanted, outside="allow")  # mistakes are errors without a catalog, too
            return catalog is not None and catalog.find(wanted) is not None

        answer: bool = run_on_root(self._ranks, is_stored)
        return answer

    @property
    def results(self) -> tuple[RenderedMember, ...]:
        """The members that this session has rendered so far, in their order, in the loop or in the background."""
        if self._background is not None:
            self._background.take_results()
        return tuple(self._results)

    def close(self, *, at_once: bool = False) -> None:
        """Close the catalog after the background queue is rendered, or dropped if `at_once`; `results` and `failures` are complete
        then.  The render window belongs to the process and serves the next session.
        """
        if self._background is not None:
            self._background.close(at_once=at_once)
        self._writer.once.repeat(self._results)
        if self.catalog is not None:
            with suppress(OSError):  # a catalog that may only be read
                self.catalog.update_table()
            if len(self._results) > 1 and not at_once:
                with suppress(CatalogError, OSError):  # of members that are damaged since
                    self._writer.once.say("", notes_on_catalog(self.catalog))
        self._writer.catalog = None

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
        time = time_of(field) if time is None else time
        policies = existing or self._existing, on_error or self._on_error
        member = MemberArguments(parameters, name, split, time, provenance, appearances, *policies)
        local = LocalField(field, FieldLocation(spacing, origin, array, dims, ghosts, nan or self._nan))
        if self._ranks is SINGLE:
            with no_traps():
                return self._render(local, member, _ghosts_alone(ghosts))
        of_block = {"array": array, "dims": dims, "nan": nan or self._nan, "time": time} if field is not None else {}
        problem = disagreement(self._ranks, {"parameters": parameters, "name": name, "split": split, **of_block})
        with no_traps(), Blocks(self._ranks, local) as blocks:
            rendered: RenderedMember = run_on_root(
                self._ranks, lambda: self._render(blocks, member, problem), blocks.commands
            )
            return rendered

    def _render(self, field: MemberInput, member: MemberArguments, problem: str = "") -> RenderedMember:
        member.check_policies()
        try:
            if problem:
                raise ValueError(problem)
            request = self._writer.request(member)
            result = self._writer.skipped(request, member.existing)
            if result is None and self._background is not None and isinstance(field, LocalField):
                _, all_appearances = self._writer.vocabulary()
                return queue_member(self._background, field, request, member.existing, self.catalog, all_appearances)
            result = result or self._writer.render(field, request, member.existing)
        except Exception as error:
            if member.on_error == "raise":
                raise
            return self._failures.add(*called(member, self._space), error, self._warn)
        self._settle(result.name, called(member, self._space)[1], result)
        return result

    @property
    def _space(self) -> ParameterSpace | None:
        """The parameters, as far as they are known here."""
        return self._writer.options.space if self.catalog is None else self.catalog.plan.space

    def _start_background(
        self, length: int, options: PlanOptions, progress: Callable[[int], None]
    ) -> Background | None:
        """The renderer process with a queue of this length; None for a session that renders in the loop."""
        if not length:
            return None
        warn = partial(warn_safely, warn=self._warn)
        return Background(self.path, options, length, settled=self._settle, warn=warn, progress=progress)

    def _settle(self, name: str, parameters: Mapping[str, float], result: RenderedMember | str) -> None:
        """Take note of a member that was rendered or skipped, or is missing for the reason given."""
        if isinstance(result, str):
            self._failures.report(name, parameters, result, self._warn)
            return
        self._failures.forget(name, parameters)
        if not result.skipped:
            self._results.append(result)


def _ghosts_alone(ghosts: Ghosts) -> str:
    """A sentence on ghost layers of a whole field, "" without any."""
    try:
        has_layers = any(map(any, ghost_layers(ghosts)))
    except ValueError as error:
        return str(error)
    return f"ghosts={ghosts!r} are layers of a block: pass comm= to the session, or cut them away" if has_layers else ""
