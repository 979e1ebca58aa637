"""The hook for one member: `render_member`."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack

from catalogs.store.plan import CatalogError
from catalogs.vocabulary.appearance import Appearance
from catalogs.vocabulary.scene import ViewPlan
from catalogs.vocabulary.variations import Variation
from insitu.fields.boxes import Box
from insitu.fields.location import Ghosts
from insitu.hook.session import Session
from insitu.members.failures import Failures, called, warn_caller
from insitu.members.planning import Space, is_catalog, space_from
from insitu.members.request import Existing, MemberArguments, OnError
from insitu.members.result import RenderedMember


class OneMember(TypedDict, total=False):
    """Keyword arguments that `render_member` passes to the method of its name."""

    name: str | None
    split: str
    time: float | None
    spacing: Sequence[float] | None
    origin: Sequence[float] | None
    array: str | None
    dims: Sequence[str] | None
    ghosts: Ghosts


class HookArguments(OneMember, total=False):
    """Further keyword arguments, which it passes to `Session`."""

    space: Space | None
    appearances: Appearance | Iterable[Appearance] | None
    views: ViewPlan | None
    bounds: Box | None
    target_decibels: float | None
    sample_distance: float | Mapping[str, float] | None
    image_format: str | None
    provenance: Mapping[str, Any] | None
    variations: Iterable[Variation] | None
    fields: Mapping[str, Any] | None
    coarse_field: bool
    backend: str
    nan: str
    existing: Existing
    on_error: OnError
    background: bool | int
    progress: Callable[[int], None] | None
    warn: Callable[[Warning], None] | None
    comm: Any


def render_member(
    field: Any,
    parameters: Mapping[str, float],
    *,
    catalog: str | os.PathLike[str],
    **arguments: Unpack[HookArguments],
) -> RenderedMember:
    """Render one member of an ensemble into a Cinema catalog; the field may be freed afterwards.

    A one-member `Session`: the first call fixes the plan, and later ones, from any process, may leave its arguments out.

    Parameters
    ----------
    field : numpy array (z, y, x), with `spacing`; a pyvista or VTK data set; or xarray's, taken by the names and coordinates
        of its axes; see `render.to_grid`.  Several fields are a mapping {name: array}, all of one shape, or a data set: every
        appearance then names its own, `field="..."`.  A function that returns one of these is called only if it is needed.
    parameters : the member's simulation parameters by name, in the units of `space`; others than its bounds with a warning.
    catalog : the `.cdb` directory.
    space : the ensemble's parameters, `{name: (low, high)}`, `{name: (low, high, unit)}`, `Parameter` objects, which have a
        scale too, or a `ParameterSpace`; needed by the first call, as are `appearances`.
    fields : the name of the shown field and its unit, `{"Q": "1/s²"}`.  Of several, `{name: unit}` by the names that appearances
        give them, or `{name: Quantity(name, unit)}` to display another name.
    appearances : transfer functions and isovalues, in the field's physical units.
    views : viewpoints and frame, by default 252 on the icosphere at 256 x 256 pixels.
    spacing, origin, array : (x, y, z) of an array, world units; the array of a data set, where appearances name no field.
    dims : an array's axes in its own order: ("x", "y", "z") for values [x, y, z]; by default (z, y, x), or as xarray's are called.
    name, split : the member's name in the catalog, by default from its parameters; "train", "validation" or "test".
    nan : "refuse" NaN and infinity, or show them "transparent".
    coarse_field : False keeps no coarse fields: those that appearances show with at most 64³ samples, in at most 0.3 MB each, from
        which surrogates are made in seconds.
    backend : "vtk", or "cpu", which needs no OpenGL.  By default volumes are drawn by the second, isosurfaces and blocks of fields
        by the first, and members of a catalog as those before them.
    target_decibels, sample_distance : PSNR that volume rendering must reach against a converged reference, by default 50 dB.
        Or in its place the step of rays in world units, one for all or by appearance.
    time : the simulation's time, recorded.  Where `space` has a parameter "time" (or "t"), it is that: every dump is a member.
    existing : where the catalog has a member with these parameters, raise an "error", "skip" it, before the field is looked at,
        or "replace" it, atomically.
    on_error : "raise"; or "warn", and report the member missing (see `Session`).
    bounds : world box ((x, y, z), (x, y, z)) that the cameras surround, by default the first member's.
    variations : appearances that sample an isovalue or a transfer function to be explored freely (`insitu.isovalue_family`,
        `transfer_function_family`), or that are learnt beside a base (`field_variation`).
    image_format, provenance : "png" (8 bits, the default) or "exr" (float32); further JSON values to record in a new catalog.
    progress, warn, comm, ghosts : as in `Session` and its `render_member`.

    Memory: VTK and OpenGL, where they draw, take some 200 MB once.  Each call takes three times the field in float32, four where
    that does not hold it exactly (of its own size).  Each further field is taken once.  Transparent values take three quarters of
    it more.

    Raises ValueError where the field, the parameters or the plan are not acceptable: nothing was written.  Raises OSError where
    the disk is full or not writable: nothing of the member was kept.

    Examples
    --------
    >>> import insitu
    >>> from blobs import APPEARANCE, PLACE, simulate
    >>> views = insitu.ViewPlan(frequency=1, width=32, height=32)
    >>> plan = {"space": {"separation": (0.6, 1.0)}, "appearances": APPEARANCE, "views": views}
    >>> insitu.render_member(simulate(0.8, 0.3), {"separation": 0.8}, catalog="one.cdb", **plan, **PLACE).images
    12
    """
    of_session: Any = dict(arguments)
    of_member: Any = {name: of_session.pop(name) for name in OneMember.__annotations__ if name in of_session}
    try:
        session = Session(catalog, **of_session)
    except (CatalogError, OSError) as error:
        if of_session.get("on_error") != "warn" or not is_catalog(Path(catalog)):
            raise  # an argument's own mistake
        member = MemberArguments(parameters, of_member.get("name"), time=of_member.get("time"))
        space, warn = space_from(of_session.get("space")), of_session.get("warn") or warn_caller
        return Failures(Path(catalog)).add(*called(member, space), error, warn)
    with session:
        return session.render_member(field, parameters, **of_member)


def _signature() -> inspect.Signature:
    """The signature of `render_member`, its `**arguments` spelt out with the defaults of `Session` and its method."""
    own = inspect.signature(render_member)
    of_session, of_member = (inspect.signature(f).parameters for f in (Session, Session.render_member))
    named = [p for p in own.parameters.values() if p.kind is not inspect.Parameter.VAR_KEYWORD]
    spelt_out = [p for p in of_session.values() if p.name not in own.parameters]
    spelt_out += [of_member[name] for name in OneMember.__annotations__]
    return own.replace(parameters=[*named, *spelt_out])


render_member.__signature__ = _signature()  # type: ignore[attr-defined]
