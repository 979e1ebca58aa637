"""Views of one field as the hook draws them and writes their files, in a process of its own.

`research.benchmarks.hook.paraview` starts it, as it has pvbatch run `pvbatch_views`.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.files.images import write_image
from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import ViewPlan
from insitu.ensembles.estimate import SHEETS
from insitu.fields.member_fields import Fields, as_fields
from insitu.members.planning import PlanOptions, measure_pilot, plan_catalog
from render.datasets import to_grid


def draw(path: str) -> None:
    """Draw the request in the JSON file `path` and write the processor seconds beside it.

    Without a step in the request it is chosen for 50 dB, as for a catalog's first member.
    """
    request = json.loads(Path(path).read_text())
    fields = fields_of(request)
    plan = plan_of(fields, request["pixels"], request["backend"], request["step"])
    distance = plan.provenance["sample_distances"][SHEETS.name]
    cameras = [Camera.from_json(camera) for camera in request["cameras"]]
    images = iter(fields.drawable(SHEETS, request["backend"]).pictures(SHEETS, cameras, distance, float_output=False))
    seconds = []
    for number in range(len(cameras)):
        begun = time.process_time()
        write_image(Path(request["pictures"]) / f"{number}.png", next(images))
        seconds.append(time.process_time() - begun)
    answer = {"views": seconds, "step": distance, "version": ""}
    Path(request["answer"]).write_text(json.dumps(answer))


def fields_of(request: dict[str, Any]) -> Fields:
    """The field of a request."""
    values = np.fromfile(request["field"], dtype=np.float32).reshape((request["size"],) * 3)
    return as_fields(to_grid(values, spacing=request["spacing"], origin=(request["origin"],) * 3), (SHEETS,))


def plan_of(fields: Fields, pixels: int, backend: str, step: float | None) -> CatalogPlan:
    """The plan of a catalog of 252 square views, which begins with this member; `step` in world units."""
    space = ParameterSpace((Parameter("phase", 0.0, 10.0),))
    views = ViewPlan(width=pixels, height=pixels)
    options = PlanOptions(space, (SHEETS,), views, backend=backend, sample_distance=step)
    return plan_catalog(measure_pilot(fields, options), options)
