"""The size of a scene's data set, estimated from a few images of one of its members."""

from __future__ import annotations

import tempfile
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from catalogs.store.sizes import Sizes
from catalogs.vocabulary.scene import Scene
from catalogs.vocabulary.words import plural
from insitu.ensembles.ensemble import pilot_members
from insitu.ensembles.sources import ensemble_of
from insitu.hook.session import Session
from insitu.members.planning import PlanOptions


@dataclass(frozen=True)
class Estimate:
    """Size of all members of a scene, and their cost on one core.

    Attributes
    ----------
    members, images : their numbers.
    sizes : bytes of all images and coarse fields.
    field_seconds, image_seconds : to make or read all fields, and to draw and store all images.
    tried : the member that this was estimated from, and with how many views.
    """

    members: int
    images: int
    sizes: Sizes
    field_seconds: float
    image_seconds: float
    tried: tuple[str, int]

    def __str__(self) -> str:
        name, views = self.tried
        minutes = (
            f"{self.field_seconds / 60:.3g} minutes for fields and {self.image_seconds / 60:.3g} for images on one core"
        )
        lines = [
            f"{plural(self.members, 'member')} with {plural(self.images, 'image')}, by {views} views of {name}:",
            f"  {self.sizes}",
            f"  {minutes}",
            *([f"  {self.sizes.advice}"] if self.sizes.advice else []),
        ]
        return "\n".join(lines)


def estimate(scene: Scene, *, progress: Callable[[float], None] = lambda fraction: None) -> Estimate:
    """Make one member's field, and draw it from 12 views in a temporary folder.

    `progress` is called with the fraction of the field that is made.  Raises ValueError for a scene whose images were made
    elsewhere, and as `insitu.make_dataset` does.
    """
    scene.check_tables()
    if scene.source["kind"] in ("nerf", "catalog", "loop"):
        raise ValueError(f"scene {scene.path}: nothing of it is rendered here, so there is nothing to estimate")
    ensemble = ensemble_of(scene)
    members = scene.assigned(ensemble.members)
    (pilot,) = pilot_members(members, ensemble.space, 1)
    options = replace(PlanOptions.of_scene(scene, ensemble.space), views=replace(scene.views, frequency=1))
    started = clock.perf_counter()
    field = ensemble.source.field(pilot, progress)
    field_seconds = clock.perf_counter() - started
    with (
        tempfile.TemporaryDirectory() as folder,
        Session(Path(folder) / "pilot.cdb", **vars(options), nan=scene.render.nan, warn=lambda note: None) as session,
    ):
        result = session.render_member(field, pilot.parameters, appearances=pilot.appearances)
    views, count = len(scene.views.splits()), len(members)
    appearance_counts = [len(scene.appearances if m.appearances is None else m.appearances) for m in members]
    images = views * sum(appearance_counts)
    share = images / result.images
    sizes = Sizes(round(share * result.sizes.images), count * result.sizes.fields, views, result.sizes.whole)
    seconds = share * (result.render_seconds + result.write_seconds)
    few = result.images // appearance_counts[members.index(pilot)]
    return Estimate(count, images, sizes, count * field_seconds, seconds, (pilot.name, few))
