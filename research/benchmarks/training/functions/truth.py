"""Ground-truth images of test members under untrained functions, rendered again from the field and stored beside the run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from catalogs.store.catalog import Catalog, Member
from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering, appearance_to_json
from catalogs.vocabulary.scene import PlannedMember, Scene
from insitu.ensembles.sources import Ensemble, ensemble_of
from insitu.fields.member_fields import Fields, as_fields
from render import render_views
from render.quality import choose_sample_distance
from research.benchmarks.training.functions.departures import appearance_name
from surrogate.evaluation.scoring import spread

FOLDER = "functions"
VERSION = 1  # of the rendering of these images


@dataclass(frozen=True, eq=False)
class TruthRequest:
    """The images to be rendered.

    Attributes
    ----------
    ensemble : source of the fields.
    catalog : the run's catalog, which gives members, cameras and base appearance.
    base : the trained appearance.
    functions : transfer functions in place of the base's, by name.
    members : test members of `catalog` that `ensemble` can make again.
    views : indices of the catalog's cameras, all of them test views.
    target_decibels : PSNR against a converged rendering.
    """

    ensemble: Ensemble
    catalog: Catalog
    base: VolumeRendering
    functions: Mapping[str, TransferFunction]
    members: Sequence[Member]
    views: Sequence[int]
    target_decibels: float

    @classmethod
    def of(
        cls,
        scene: Scene,
        catalog: Catalog,
        base: VolumeRendering,
        functions: Mapping[str, TransferFunction],
        members: int,
        views: int,
    ) -> TruthRequest:
        """A request for at most `members` test members and `views` test views, evenly spread.

        Raises ValueError where the scene's fields are not available again, or the catalog has no test members or shared
        test views.
        """
        ensemble, plan = ensemble_of(scene), catalog.plan
        again = {member.name for member in ensemble.members}
        tested = [member for member in catalog.members if member.split == "test" and member.name in again]
        seen_by = [view for view, split in enumerate(plan.view_splits) if split == "test"]
        if not tested or not seen_by:
            raise ValueError(
                f"{catalog.path} has {len(tested)} test members of scene {scene.name} and {len(seen_by)} shared test views: at "
                "least one of each is needed"
            )
        return cls(
            ensemble,
            catalog,
            base,
            functions,
            [tested[i] for i in spread(len(tested), members)],
            [seen_by[i] for i in spread(len(seen_by), views)],
            scene.render.target_decibels,
        )

    @property
    def appearances(self) -> tuple[VolumeRendering, ...]:
        """The appearance for each function."""
        return tuple(
            replace(self.base, name=appearance_name(n), transfer_function=f) for n, f in self.functions.items()
        )

    @property
    def mark(self) -> str:
        """A mark that changes with everything that determines the images, other than the members."""
        plan, source = self.catalog.plan, dict(self.ensemble.source.identity)
        cameras = [plan.cameras[view].to_json() for view in self.views]
        shown = [appearance_to_json(appearance) for appearance in self.appearances]
        text = json.dumps([VERSION, shown, cameras, source, plan.bounds, self.target_decibels], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def truth(wanted: TruthRequest, run: Path, say: Callable[[str], None] = lambda _: None) -> Catalog:
    """A catalog with these images, and maybe other members, in the folder of a run; only missing images are rendered."""
    path = run / FOLDER / f"{wanted.mark}.cdb"
    catalog = Catalog.open(path) if path.is_dir() else None
    planned = {member.name: member for member in wanted.ensemble.members}
    for number, member in enumerate(wanted.members, start=1):
        if catalog is not None and member.name in catalog:
            continue
        say(f"rendering member {number} of {len(wanted.members)}, {member.name}")
        fields = _fields(wanted, planned[member.name])
        catalog = catalog or _created(path, wanted, fields)
        _render(catalog, member, fields)
    return Catalog.open(path)


def _fields(wanted: TruthRequest, member: PlannedMember) -> Fields:
    data = wanted.ensemble.source.field(member, lambda _: None)
    return as_fields(data, [wanted.base], all_appearances=wanted.catalog.plan.appearances)


def _created(path: Path, wanted: TruthRequest, first: Fields) -> Catalog:
    """The catalog without members; its sample distances follow from the first member's fields."""
    plan, grid = wanted.catalog.plan, first.shown_by(wanted.base)
    cameras = tuple(plan.cameras[view] for view in wanted.views)
    distances = {
        appearance.name: choose_sample_distance(grid, appearance, cameras, wanted.target_decibels, warn=False).distance
        for appearance in wanted.appearances
    }
    provenance = {"sample_distances": distances, "target_decibels": wanted.target_decibels}
    splits = ("test",) * len(cameras)
    path.parent.mkdir(exist_ok=True)
    shown = CatalogPlan(plan.space, wanted.appearances, cameras, splits, plan.bounds, provenance=provenance)
    return Catalog.create(path, replace(shown, quantities=plan.quantities))


def _render(catalog: Catalog, member: Member, fields: Fields) -> None:
    distances = catalog.plan.provenance["sample_distances"]
    with catalog.begin_member(member.name, member.parameters, split="test", outside="allow") as writer:
        for appearance in catalog.plan.appearances:
            grid = fields.shown_by(appearance)
            pictures = render_views(grid, appearance, catalog.plan.cameras, sample_distance=distances[appearance.name])
            for view, picture in enumerate(pictures):
                writer.write_image(appearance.name, view, picture)
