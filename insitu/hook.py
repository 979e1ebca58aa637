"""The hook: render one member of an ensemble into a catalog, from anybody's simulation loop."""

from __future__ import annotations

import hashlib
import inspect
import os
import sys
import time as clock
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from catalogs.appearance import Appearance, VolumeRendering, shown_fields
from catalogs.catalog import Catalog, CatalogPlan, MemberWriter
from catalogs.members import known_appearances
from catalogs.parameters import SPLITS, ParameterSpace
from catalogs.plan import CatalogError, json_values, name_problem
from catalogs.scene import ViewPlan
from catalogs.variations import Variation
from insitu.agreement import agreeing_catalog, create_catalog, notes_on_member
from insitu.boxes import Box
from insitu.fields import Fields, as_fields
from insitu.planning import PlanOptions, appearances_from, check_complete, measure_pilot, space_from
from insitu.rendered import PeakMemory, RenderedMember
from insitu.summarize import summarize_shown
from render.datasets import ResamplingWarning

LONGEST_NAME = 80
# What `render_member` hands on to the method of its name; the rest goes to `Session`.
OF_MEMBER = ("name", "split", "time", "spacing", "origin", "array")


def warn_caller(note: Warning) -> None:
    """Warn of `note` at the line that called into this package, however deep the call."""
    frame: FrameType | None = sys._getframe()
    level = 1
    while frame is not None and frame.f_globals.get("__name__", "").startswith("insitu."):
        frame, level = frame.f_back, level + 1
    warnings.warn(note, stacklevel=level)


class Session:
    """A catalog held open while the members of an ensemble arrive one at a time.

    The first member of a new catalog fixes what was left open: the cameras stand around `bounds`, or around that
    member's box; the sample distance is chosen on it.  Everything stays fixed from then on, in physical units:
    nothing is normalized per member.  With a catalog that exists (made earlier, or by another process meanwhile) every
    argument given must agree with it, else ValueError names the differences.

    A later member that reaches out of the ensemble's box is refused (ValueError): the cameras are not set for it.
    One that is smaller is rendered where it is, with a warning unless `bounds` were given, since spacing or origin may
    have been forgotten.

    Use it as a context manager.  Parameters are those of the function `render_member`; besides,
    `progress` is called with the number of images drawn of a member, and `warn` with each warning, which otherwise is given
    at the caller's line.

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
        warn: Callable[[Warning], None] | None = None,
    ) -> None:
        self.path = Path(catalog)
        self._options = PlanOptions(
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
        self._nan, self._progress, self._warn = nan, progress or (lambda images: None), warn or warn_caller
        self._catalog = agreeing_catalog(self.path, self._options)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        members = "not made yet" if self._catalog is None else f"{len(self._catalog.member_paths())} members"
        return f"Session({str(self.path)!r}, {members})"

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
        catalog = self._catalog
        space, known = (
            check_complete(self._options) if catalog is None else (catalog.plan.space, catalog.plan.appearances)
        )
        space.values(parameters, outside="allow")  # wrong names are refused before the field is looked at
        wanted = known_appearances(appearances, [a.name for a in known])
        shown = [a for a in known if a.name in wanted]
        name = name or member_name(parameters)
        record = _record(name, split, provenance, time)
        fields = as_fields(
            field,
            known if catalog is None else shown,  # a new catalog's sample distances need all fields
            known=known,
            spacing=spacing,
            origin=origin,
            array=array,
            nan=nan or self._nan,
        )
        memory.sample()
        with _named_disk_errors(name, self.path):
            catalog = self._catalog = catalog or self._created(fields)
            notes = notes_on_member(fields.box, parameters, catalog.plan)
            for note in [*map(ResamplingWarning, fields.notes), *map(UserWarning, notes)]:
                self._warn(note)
            record["bounds"] = fields.box
            if fields.notes or notes:
                record["warnings"] = [*fields.notes, *notes]
            with catalog.begin_member(
                name, parameters, split=split, provenance=record, appearances=wanted, outside="allow"
            ) as writer:
                written = self._write(fields, shown, catalog.plan, writer, memory)
        return RenderedMember(
            name=name,
            path=catalog.path / "members" / name,
            **written,
            seconds=clock.perf_counter() - started,
            extra_memory=memory.extra_bytes,
            warnings=(*fields.notes, *notes),
        )

    def _created(self, fields: Fields) -> Catalog:
        """The catalog, made for its first member's fields."""
        pilot = measure_pilot(fields, self._options)
        for note in pilot.notes:
            self._warn(UserWarning(note))
        return create_catalog(self.path, pilot, self._options)

    def _write(
        self, fields: Fields, shown: Sequence[Appearance], plan: CatalogPlan, writer: MemberWriter, memory: PeakMemory
    ) -> dict[str, Any]:
        """Write a member's images, one in memory at a time, and its fields' summaries; returns figures for `RenderedMember`."""
        from render import render_views

        started, written, images = clock.perf_counter(), 0.0, 0
        distances = plan.provenance.get("sample_distances", {})
        for appearance in shown:
            pictures = render_views(
                fields.shown_by(appearance),
                appearance,
                plan.cameras,
                sample_distance=distances.get(appearance.name) if isinstance(appearance, VolumeRendering) else None,
                float_output=plan.image_format == "exr",
            )
            for view, rgba in enumerate(pictures):
                before = clock.perf_counter()
                writer.write_image(appearance.name, view, rgba)
                written, images = written + clock.perf_counter() - before, images + 1
                memory.sample()
                self._progress(images)
        rendered = clock.perf_counter() - started - written
        summaries = summarize_shown({name: fields.grids[name] for name in shown_fields(shown)}, plan)
        memory.sample()
        writer.write_summaries(summaries)
        return {
            "images": images,
            "render_seconds": rendered,
            "write_seconds": written,
            "ranges": {name: (kept.minimum, kept.maximum) for name, kept in summaries.items()},
            "clipped_fractions": {name: kept.clipped_fraction for name, kept in summaries.items()},
        }


def render_member(
    field: Any, parameters: Mapping[str, float], *, catalog: str | os.PathLike[str], **arguments: Any
) -> RenderedMember:
    """Render one member of an ensemble into a Cinema catalog; afterwards its field may go.

    The first call makes the catalog and fixes its plan; later calls, from this process or another, may leave the plan's
    arguments out, and must agree with the catalog where they state them.  A one-member `Session`.

    Parameters
    ----------
    field : numpy array (z, y, x), with `spacing`; or a pyvista or VTK data set; see `render.to_grid`.  Several fields are
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
    target_decibels, sample_distance : how exact volume rendering must be, as PSNR against a converged reference (50 dB), or the
        step of its rays in world units, one for all or by appearance.
    time : the simulation's time, recorded.
    bounds : world box ((x, y, z), (x, y, z)) around which the cameras stand, by default the first member's.
    variations : which of the appearances sample an isovalue or a transfer function that is to be explored freely
        (`catalogs.variations.isovalue_family`, `transfer_function_family`), or are to be learnt beside a base (`field_variation`).
    image_format : "png" (8 bits, the default) or "exr" (float32).
    provenance : further JSON values to record in a new catalog.
    progress, warn : as in `Session`.

    Memory: VTK and OpenGL take some 200 MB once; each call three times the field in float32 (the samples, the same scaled
    to the transfer function's range, and the texture), once each further field, and one image at a time.  All of it is freed again
    but the first.

    Raises
    ------
    ValueError : the field, the parameters or the plan are not acceptable; nothing was written.
    OSError : the disk is full or not writable; nothing of the member was kept.
    """
    of_member = {name: arguments.pop(name) for name in OF_MEMBER if name in arguments}
    with Session(catalog, **arguments) as session:
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


def member_name(parameters: Mapping[str, float]) -> str:
    """A member's default name: its parameters, or a digest of them where that would be too long or not allowed."""
    text = "_".join(f"{name}-{float(value)!r}" for name, value in parameters.items())
    text = "".join(c if c.isalnum() or c in "-_." else "-" for c in text)
    fits = len(text) <= LONGEST_NAME and name_problem(text) is None
    return text if fits else "member-" + hashlib.sha256(text.encode()).hexdigest()[:12]


def _record(name: str, split: str, provenance: Mapping[str, Any] | None, time: float | None) -> dict[str, Any]:
    """The provenance of a member; refuses a bad name, split or value before a new catalog is made for it."""
    if split not in SPLITS:
        raise ValueError(f"split must be one of {SPLITS}, got {split!r}")
    problem = name_problem(name)
    if problem:
        raise CatalogError(f"a member can't be called so: {problem}")
    told = {**(provenance or {}), **({} if time is None else {"time": float(time)})}
    return json_values(told, f"the provenance of member {name}")


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
