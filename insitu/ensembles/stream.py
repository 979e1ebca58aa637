"""A stream of steps, rendered as they arrive: one simulation's, whose every step says its parameters itself."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from insitu.fields.location import FieldLocation
from insitu.hook.session import Session
from insitu.members.planning import PlanOptions
from insitu.members.request import Existing, member_name
from insitu.readers.attributes import wanted_array
from insitu.readers.files import volume
from insitu.readers.placement import placed_field

if TYPE_CHECKING:
    from insitu.readers.adios import StreamStep


@dataclass
class StreamResult:
    """The outcome of a stream.

    Attributes
    ----------
    rendered, skipped : names of members.
    failures : the reasons why others are missing.
    lacking : steps without the fields.
    """

    rendered: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    failures: dict[str, str] = field(default_factory=dict)
    lacking: list[str] = field(default_factory=list)


def render_stream(
    catalog: str | os.PathLike[str],
    steps: Iterable[StreamStep],
    options: PlanOptions,
    *,
    arrays: tuple[str, ...] = (),
    location: FieldLocation = FieldLocation(),  # noqa: B008 - frozen
    nan: str = "refuse",
    existing: Existing = "skip",
    arrived: StreamResult | None = None,
    say: Callable[[str], None] = lambda text: None,
    warn: Callable[[Warning], None] | None = None,
) -> StreamResult:
    """Render every step of a stream that the catalog lacks.

    Parameters
    ----------
    steps : as they arrive; each says its parameters, and holds its arrays.
    options : what the catalog fixes, or must agree with; its space names the parameters.
    arrays : those that are the fields; () where there is one.
    location : spacing, origin and dims of arrays that do not say.
    nan, existing : as in `render_member`.
    arrived : where it is noted what became of the steps, for a caller who interrupts.
    say : called with a line about each member that was rendered, and about each failure.

    A step that can't be rendered is reported, and the next one is awaited.  Steps without the fields are left out, of which the
    first is reported.  Raises ValueError as `Session` does, and where no step had the fields.
    """
    arrived = arrived or StreamResult()
    if options.space is None:
        raise ValueError("the options must name the parameters")
    plan_options = {f.name: getattr(options, f.name) for f in dataclasses.fields(options)}
    with Session(catalog, **plan_options, nan=nan, existing=existing, on_error="raise", warn=warn) as session:
        for step in steps:
            name = f"step {step.number}"
            absent = [array for array in arrays if wanted_array(step.arrays, array) is None]
            if absent or not step.arrays.arrays:
                if not arrived.lacking:
                    say(f"{name} lacks {' and '.join(absent) or 'a field'}; such steps are left out")
                arrived.lacking.append(name)
                continue
            try:
                lacking = [parameter for parameter in options.space.names if parameter not in step.says]
                if lacking:
                    raise ValueError(f"it does not say {lacking}; it says {dict(step.says)}")
                parameters = {parameter: step.says[parameter] for parameter in options.space.names}
                name = member_name(parameters)
                member = session.render_member(_field(step, arrays, location), parameters)
            except (ValueError, TypeError, RuntimeError) as error:
                arrived.failures[name] = f"{type(error).__name__}: {error}"
                say(f"{name} can't be rendered: {error}")
                continue
            (arrived.skipped if member.skipped else arrived.rendered).append(member.name)
            if not member.skipped:
                say(f"rendered {member.name}; {len(arrived.rendered)} in all")
    if arrived.lacking and not (arrived.rendered or arrived.skipped or arrived.failures):
        raise ValueError(f"none of {len(arrived.lacking)} steps had {' and '.join(arrays) or 'a field'}")
    return arrived


def _field(step: StreamStep, arrays: tuple[str, ...], location: FieldLocation) -> Any:
    """The field of a step, or its fields by name."""
    if not arrays:
        return placed_field(step.arrays, volume(step.arrays, None), location=location)
    return {name: placed_field(step.arrays, volume(step.arrays, name), location=location) for name in arrays}
