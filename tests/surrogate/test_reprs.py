"""Records of tensors print as one line that says what they are, however many numbers they hold."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import surrogate
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.words import WIDTH
from surrogate.appearance.field_gaussians import FieldValues
from surrogate.appearance.scale import ValueScale
from surrogate.deformation import Offsets
from surrogate.deformation.transfer import Transfer
from surrogate.initialization.field_points import FieldPoints
from surrogate.initialization.from_field import start_from_field
from surrogate.initialization.on_surfaces import EmulatedSurfaces
from surrogate.initialization.pictures import Picture, StartPoints
from surrogate.initialization.structure_from_motion import Track
from surrogate.model import MeanMember
from surrogate.model.places import VariedPoint, place_of
from surrogate.model.points import BothPoints
from surrogate.model.representation import RepresentationScores
from surrogate.rasterizer import primitives
from surrogate.settings import TrainingSettings
from surrogate.splatting import Constants, draw, reference
from surrogate.splatting.kernel_function import KernelFunction
from surrogate.storage.checkpoints import Checkpoint
from surrogate.storage.encoding import encode
from surrogate.storage.models import StoredModel
from surrogate.storage.records import Provenance, Record
from surrogate.storage.runs import RunFolder, RunRecord
from tests.support.emulated import some_field_model
from tests.support.hooked import FUNCTION
from tests.support.surrogates import CENTER, some_surrogate
from tests.support.visualizations import base, of_functions

CAMERA = Camera.look_at((0.0, -4.0, 0.5), (0.0, 0.0, 0.0), vertical_fov_degrees=35, width=24, height=20)
MODEL = some_surrogate()
DRAWN = primitives(MODEL.gaussians, CAMERA)
FOLLOWING = of_functions(base())
ROOMS = ("splatting", "deformation", "initialization", "storage", "gaussians", "rasterizer", "model")
POINTS = FieldPoints(
    ("m",),
    np.zeros((1, 2), np.float32),
    np.zeros((7, 3), np.float32),
    np.zeros(7),
    np.zeros(7, np.int64),
    np.ones(7, bool),
)
EMULATED = some_field_model()
EMULATOR = EMULATED.emulators[""]
FIELD_POINT = EMULATED.point({"p": 0.5}, "allow")
VALUES = FieldValues(FUNCTION, ValueScale.of_function(FUNCTION))
START = start_from_field(TrainingSettings(gaussians=5), EMULATOR, VALUES, EMULATED.normalization)
BOTH_POINTS = BothPoints(place_of(MODEL.space, (), {"Re": 1830.0, "time": 1.0}, "allow"), FIELD_POINT)
SHOWN: list[tuple[Any, str]] = [
    (MODEL, "<Surrogate of Re 1500..2500"),
    (MODEL.at(Re=1830.0, time=1.0), "<DeformedGaussians at Re=1830"),
    (
        place_of(MODEL.space, (), {"Re": 1830.0, "time": 1.0}, "warn"),
        "ParameterPoint(parameters={2 entries}, simulation[2]",
    ),
    (MODEL.gaussians, "Gaussians(means[30, 3], log_scales[30, 3], quats[30, 4], opacity_logits[30], colors[30, 3]"),
    (MODEL.normalization, "extent=40.0"),
    (MODEL.rasterizer, "backend='reference'"),
    (MODEL.deformation, "BilinearDeformation(latents[30, 4], weights_in[8, 2]"),
    (FOLLOWING.deformation, "ValuesDeformation(weights["),
    (FOLLOWING, "Visualization(variation="),
    (Offsets(*MODEL.gaussians.tensors().values()), "Offsets(means[30, 3]"),
    (Transfer(np.zeros((5, 4)), ((0.0, 0.5, 1.0),) * 50), "Transfer(changes[5, 4]"),
    (Constants(), "Constants(near=0.02"),
    (DRAWN, "Primitives(means[30, 3]"),
    (draw(DRAWN, CAMERA, Constants()), "Rendering(color[20, 24, 3], alpha[20, 24], depth=None)"),
    (KernelFunction("sum", "twin", sum, lambda arrays, by: (by, by)), "KernelFunction(name='sum', reference='twin'"),
    (reference.project(DRAWN, CAMERA, Constants()), "Splats(centers["),
    (StartPoints(np.zeros((7, 3)), None), "StartPoints(places[7, 3], colors=None, values=None)"),
    (POINTS, "<FieldPoints: 7 of 1 members, 7 of them evenly>"),
    (Picture(CAMERA, np.zeros((20, 24, 4), np.uint8)), "Picture(camera="),
    (Track(CENTER, np.zeros((4, 3), np.intp)), "Track(place[3], pixels[4, 3])"),
    (encode(MODEL.gaussians.means, "uint8"), "Encoding(form='uint8', codes[30, 3], low[3], step[3])"),
    (StoredModel(MODEL.gaussians.tensors()), "StoredModel(tensors={5 entries}"),
    (Checkpoint(MODEL.gaussians.tensors(), {"step": 3}), "Checkpoint(tensors={5 entries}, record={1 entries})"),
    (Record("ceiling", 1, {}, {}), "Record(kind='ceiling'"),
    (RunRecord("a.cdb", {}), "RunRecord(catalog='a.cdb'"),
    (RunFolder(Path("runs") / "a"), "RunFolder(folder="),
    (Provenance(), "Provenance(commit='unknown'"),
    (EMULATED, "FieldModel(emulators="),
    (EMULATED.member(FIELD_POINT), "<EmulatedMember at p=0.5: 8 x 8 x 8 samples>"),
    (FIELD_POINT, "FieldPoint(parameters={1 entries}"),
    (BOTH_POINTS, "BothPoints(gaussians="),
    (MeanMember(MODEL.at(Re=1830.0, time=1.0), EMULATED.member(FIELD_POINT)), "<MeanMember at p=0.5"),  # type: ignore[arg-type]
    (RepresentationScores({"view": {"field": 40.0}}), "RepresentationScores(psnr="),
    (START, "StartFromField(gaussians="),
    (
        EmulatedSurfaces(EMULATOR, FOLLOWING.variation, np.zeros((4, 3, 3)), np.ones(4), 1.0),
        "EmulatedSurfaces(emulator[",
    ),
    (START.emulated, "EmulatedValues(means[5], modes[5, "),
    (VariedPoint(0, {}, None, ()), "VariedPoint(number=0"),
]


@pytest.mark.parametrize(("shown", "words"), SHOWN, ids=lambda value: type(value).__name__)
def test_a_repr_is_one_line(shown: Any, words: str) -> None:
    assert words in repr(shown)
    assert len(repr(shown).splitlines()) == 1
    assert len(repr(shown)) <= 2 * WIDTH  # of those that are written out


def test_what_is_long_is_cut() -> None:
    assert len(repr(FOLLOWING)) == WIDTH
    assert repr(FOLLOWING).endswith("…)")


def test_every_public_record_is_in_the_table() -> None:
    names = [m.name for m in pkgutil.walk_packages(surrogate.__path__, "surrogate.")]
    modules = [importlib.import_module(name) for name in names if name.split(".")[1] in ROOMS]
    public = {
        value
        for module in modules
        for name, value in vars(module).items()
        if not name.startswith("_") and isinstance(value, type) and value.__module__ == module.__name__
        if dataclasses.is_dataclass(value) or hasattr(value, "_fields")
    }
    known = {form for shown, _ in SHOWN for form in type(shown).__mro__}
    assert {form.__name__ for form in public - known} == set()
