"""The size of a scene's data set, estimated from a few images of some members."""

from __future__ import annotations

import tempfile
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from catalogs.store.sizes import Sizes
from catalogs.vocabulary.scene import Scene
from catalogs.vocabulary.words import plural
from insitu.ensembles.sources import ensemble_of
from insitu.hook.session import Session
from insitu.members.planning import PlanOptions
from insitu.members.result import RenderedMember

TRIED = 5  # members, spread over the scene


@dataclass(frozen=True)
class Estimate:
    """Size of all members of a scene, and their cost on one core.

    Attributes
    ----------
    members, images : their numbers.
    sizes : bytes of all images and coarse fields.
    field_seconds, image_seconds : to make or read all fields, and to draw and store all images.
    tried : from how many members this was estimated, and from how many views of each.
    """

    members: int
    images: int
    sizes: Sizes
    field_seconds: float
    image_seconds: float
    tried: tuple[int, int]

    def __str__(self) -> str:
        count, views = self.tried
        minutes = (
            f"{self.field_seconds / 60:.1f} minutes for fields and {self.image_seconds / 60:.1f} for images on one core"
        )
        lines = [
            f"{plural(self.members, 'member')} with {plural(self.images, 'image')}, by {views} views of {count}:",
            f"  {self.sizes}",
            f"  {minutes}",
            *([f"  {self.sizes.advice}"] if self.sizes.advice else []),
        ]
        return "\n".join(lines)


def estimate(scene: Scene, *, progress: Callable[[float], None] = lambda fraction: None) -> Estimate:
    """Make the fields of five members, of one where they are simulated, and draw them from 12 views in a temporary folder.

    `progress` is called with the fraction of a field that is made.  Raises ValueError for a scene whose images were made
    elsewhere, and as `insitu.make_dataset` does.
    """
    scene.check_tables()
    if scene.source["kind"] in ("nerf", "catalog", "loop"):
        raise ValueError(f"scene {scene.path}: nothing of it is rendered here, so there is nothing to estimate")
    ensemble = ensemble_of(scene)
    members = scene.assigned(ensemble.members)
    count = min(len(members), 1 if ensemble.source.expensive else TRIED)
    chosen = [members[(2 * i + 1) * len(members) // (2 * count)] for i in range(count)]
    options = replace(PlanOptions.of_scene(scene, ensemble.space), views=replace(scene.views, frequency=1))
    field_seconds, results = 0.0, list[RenderedMember]()
    with (
        tempfile.TemporaryDirectory() as folder,
        Session(Path(folder) / "pilot.cdb", **vars(options), nan=scene.render.nan, warn=lambda note: None) as session,
    ):
        for member in chosen:
            started = clock.perf_counter()
            field = ensemble.source.field(member, progress)
            field_seconds += clock.perf_counter() - started
            results.append(session.render_member(field, member.parameters, appearances=member.appearances))
    counts = [len(scene.appearances if m.appearances is None else m.appearances) for m in members]
    views, of_these = len(scene.views.splits()), sum((result.sizes for result in results), Sizes(whole=True))
    images, few, share = views * sum(counts), sum(result.images for result in results), len(members) / count
    sizes = Sizes(round(images / few * of_these.images), round(share * of_these.fields), views, of_these.whole)
    seconds = images / few * sum(result.render_seconds + result.write_seconds for result in results)
    return Estimate(len(members), images, sizes, share * field_seconds, seconds, (count, of_these.views))
