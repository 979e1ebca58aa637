"""The pictures and summaries of one member, drawn and written."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from typing import Any

from catalogs.store.catalog import CatalogPlan, MemberWriter
from catalogs.vocabulary.appearance import VolumeRendering, field_of, shown_fields
from insitu.fields.member_fields import MemberFields
from insitu.members.blank import PictureNote, note_on_pictures
from insitu.members.request import MemberRequest
from insitu.members.result import PeakMemory


def write_member(
    fields: MemberFields,
    request: MemberRequest,
    distances: Mapping[str, float],
    plan: CatalogPlan,
    writer: MemberWriter,
    memory: PeakMemory,
    progress: Callable[[int], None],
) -> tuple[dict[str, Any], list[PictureNote]]:
    """Write a member's images, one in memory at a time, and its fields' summaries; `distances` are those of rays' samples.

    Returns figures for `RenderedMember`, and what deserves a warning about the pictures.
    """
    started, written, images = clock.perf_counter(), 0.0, 0
    covered: set[str] = set()  # appearances
    for appearance in request.shown:
        distance = distances.get(appearance.name) if isinstance(appearance, VolumeRendering) else None
        pictures = fields.drawable(appearance).pictures(
            appearance, plan.cameras, distance, float_output=plan.image_format == "exr"
        )
        for view, rgba in enumerate(pictures):
            before = clock.perf_counter()
            writer.write_image(appearance.name, view, rgba)
            written, images = written + clock.perf_counter() - before, images + 1
            if appearance.name not in covered and rgba[..., 3].any():
                covered.add(appearance.name)
            memory.sample()
            progress(images)
    rendered = clock.perf_counter() - started - written
    summaries = fields.summaries(shown_fields(request.shown), plan)
    memory.sample()
    writer.write_summaries(summaries)
    notes = [note_on_pictures(a, summaries[field_of(a)], blank=a.name not in covered) for a in request.shown]
    figures = {
        "images": images,
        "render_seconds": rendered,
        "write_seconds": written,
        "quantities": {name: plan.quantity(name) for name in summaries},
        "ranges": {name: (kept.minimum, kept.maximum) for name, kept in summaries.items()},
        "clipped_fractions": {name: kept.clipped_fraction for name, kept in summaries.items()},
    }
    return figures, [note for note in notes if note is not None]
