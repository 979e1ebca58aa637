"""Members rendered into one catalog, one after the other, in this process."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from catalogs.store.catalog import Catalog, CatalogPlan, MemberWriter
from catalogs.vocabulary.appearance import Appearance, VolumeRendering, field_of, shown_fields
from catalogs.vocabulary.parameters import ParameterSpace
from insitu.fields.distances import member_distances
from insitu.fields.member_fields import LocalField, MemberFields, MemberInput
from insitu.members.agreement import agreeing_catalog, create_catalog, notes_on_member
from insitu.members.backends import member_backends
from insitu.members.blank import PictureNote, note_on_pictures
from insitu.members.conflicts import stored_name, under_stored_name
from insitu.members.failures import named_disk_errors
from insitu.members.notes import NO_SPACING, Once, said_of
from insitu.members.planning import PlanOptions, check_complete, measure_pilot
from insitu.members.request import Existing, MemberArguments, MemberRequest, member_request
from insitu.members.result import PeakMemory, RenderedMember
from render.datasets import ResamplingWarning


class CatalogWriter:
    """The catalog at `path`, as `options` plan it; its first member makes it.

    `progress` is called with the number of images drawn of a member, `warn` with each kind of warning once, and `created` once
    there is a new catalog.
    """

    def __init__(
        self,
        path: Path,
        options: PlanOptions,
        *,
        progress: Callable[[int], None],
        warn: Callable[[Warning], None],
        created: Callable[[], None] = lambda: None,
    ) -> None:
        self.path, self.options = path, options
        self.catalog: Catalog | None = None
        self._progress, self._created = progress, created
        self.once = Once(warn, said_of(path))

    def find_catalog(self) -> Catalog | None:
        """The catalog, if there is one, made by this process or another; raises ValueError where it has another plan."""
        if self.catalog is None:
            self.catalog = agreeing_catalog(self.path, self.options)
        return self.catalog

    def vocabulary(self) -> tuple[ParameterSpace, Sequence[Appearance]]:
        """The parameters and all appearances; raises ValueError where neither a catalog nor the options say."""
        catalog = self.find_catalog()
        return check_complete(self.options) if catalog is None else (catalog.plan.space, catalog.plan.appearances)

    def request(self, member: MemberArguments) -> MemberRequest:
        """See `insitu.members.request.member_request`."""
        return member_request(*self.vocabulary(), member)

    def skipped(self, request: MemberRequest, existing: Existing) -> RenderedMember | None:
        """The result for a stored member that may stay; None for one to render.  Raises CatalogError for a conflict."""
        catalog = self.find_catalog()
        name = None if catalog is None else stored_name(catalog, request, existing)
        return None if name is None else RenderedMember(name, self.path / "members" / name, skipped=True)

    def write(self, field: MemberInput, member: MemberArguments) -> RenderedMember:
        """Render a member, or skip it; raises what is wrong with it."""
        request = self.request(member)
        return self.skipped(request, member.existing) or self.render(field, request, member.existing)

    def render(self, field: MemberInput, request: MemberRequest, existing: Existing) -> RenderedMember:
        """Render a member that is not stored yet, or is to be replaced."""
        started, memory, replace = clock.perf_counter(), PeakMemory(), existing == "replace"
        _, all_appearances = self.vocabulary()
        # A new catalog's sample distances need all fields.
        fields = field.take(all_appearances if self.catalog is None else request.appearances, all_appearances)
        memory.sample()
        with named_disk_errors(request.name, self.path):
            if self.catalog is None and isinstance(field, LocalField) and field.lacks_spacing:
                self.once.say("", [NO_SPACING])
            catalog = self.catalog or self._create(fields)
            request = under_stored_name(catalog, request) if replace else request
            backends, mixed = member_backends(fields, request.appearances, self.options.backend, catalog.plan)
            distances, coarse = member_distances(fields, request.appearances, catalog.plan, backends)
            notes = [*notes_on_member(fields.box, request.parameters, catalog.plan), *mixed, *coarse]
            self.once.say("", [*map(ResamplingWarning, fields.notes), *notes])
            warnings: tuple[str, ...] = (*fields.notes, *notes)
            record = {
                "bounds": fields.box,
                **({"sample_distances": distances} if coarse else {}),
                **({"backends": backends} if mixed else {}),
            }
            with catalog.begin_member(
                request.name,
                request.parameters,
                split=request.split,
                provenance={**request.record, **record},
                appearances=[appearance.name for appearance in request.appearances],
                outside="allow",
                replace=replace,
            ) as writer:
                figures, of_images = write_member(
                    fields, request, (distances, backends), catalog.plan, writer, memory, self._progress
                )
                if self.options.coarse_field and (coarse_fields := fields.coarse(shown_fields(request.appearances))):
                    writer.write_coarse_fields(coarse_fields)
                warnings = (*warnings, *map(str, of_images))
                if warnings:
                    writer.add_provenance(warnings=warnings)
        self.once.say("", map(str, of_images))
        return RenderedMember(
            name=request.name,
            path=catalog.path / "members" / request.name,
            **figures,
            seconds=clock.perf_counter() - started,
            extra_memory=memory.extra_bytes,
            warnings=warnings,
            sizes=writer.sizes,
        )

    def _create(self, fields: MemberFields) -> Catalog:
        """The catalog, made for its first member's fields."""
        pilot = measure_pilot(fields, self.options)
        self.once.say("", pilot.notes)
        self.catalog = create_catalog(self.path, pilot, self.options)
        self._created()
        return self.catalog


def write_member(
    fields: MemberFields,
    request: MemberRequest,
    drawing: tuple[Mapping[str, float], Mapping[str, str]],
    plan: CatalogPlan,
    writer: MemberWriter,
    memory: PeakMemory,
    progress: Callable[[int], None],
) -> tuple[dict[str, Any], list[PictureNote]]:
    """Write a member's images, one in memory at a time, and its fields' summaries.

    `drawing` has, by appearance, the sample distances along rays and the backends.

    Returns figures for `RenderedMember`, and what deserves a warning about the pictures.
    """
    distances, backends = drawing
    started, written, images = clock.perf_counter(), 0.0, 0
    covered: set[str] = set()  # appearances
    for appearance in request.appearances:
        distance = distances.get(appearance.name) if isinstance(appearance, VolumeRendering) else None
        pictures = fields.drawable(appearance, backends.get(appearance.name, "")).pictures(
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
    summaries = fields.summaries(shown_fields(request.appearances), plan)
    memory.sample()
    writer.write_summaries(summaries)
    notes = [note_on_pictures(a, summaries[field_of(a)], blank=a.name not in covered) for a in request.appearances]
    figures = {
        "images": images,
        "render_seconds": rendered,
        "write_seconds": written,
        "quantities": {name: plan.quantity(name) for name in summaries},
        "ranges": {name: (summary.minimum, summary.maximum) for name, summary in summaries.items()},
        "clipped_fractions": {name: summary.clipped_fraction for name, summary in summaries.items()},
    }
    return figures, [note for note in notes if note is not None]
