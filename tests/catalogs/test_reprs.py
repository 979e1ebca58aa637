"""Whatever a catalog is made of prints as one line that says what it is, however many cameras and settings it holds."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import catalogs
from catalogs import doctor
from catalogs.exchange import selection
from catalogs.exchange.nerf import ImportedMember
from catalogs.exchange.transforms import Frame
from catalogs.files.durable import Stamp
from catalogs.files.packed import ENTRY, Pack
from catalogs.files.png import PngHeader
from catalogs.progress import Count
from catalogs.store.catalog import Catalog
from catalogs.store.coarse import CoarseField
from catalogs.store.digests import Digests
from catalogs.store.journal import Stamps
from catalogs.store.members import Member
from catalogs.store.missing import MissingMember
from catalogs.store.notebook.cards import CardImage
from catalogs.store.plan import CatalogPlan
from catalogs.store.sizes import Sizes
from catalogs.store.splits import Splits
from catalogs.store.summary import FieldSummary
from catalogs.tools.check import Finding
from catalogs.tools.damage import ExpectedImage
from catalogs.tools.merge import Merged
from catalogs.tools.packing import Transferred
from catalogs.tools.repair import Repaired, SetAside
from catalogs.tools.split import Shard
from catalogs.vocabulary.appearance import ImportedImages, Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import orbit, view_splits
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.plugin_appearance import MissingAppearance
from catalogs.vocabulary.quantity import Quantity
from catalogs.vocabulary.scene import PlannedMember, RenderPlan, Scene, VariedMembers, ViewPlan
from catalogs.vocabulary.variations import VariationSetting, field_variation, isovalue_family, transfer_function_family
from catalogs.web.access import Access

LONGEST = 400
SCENE = Path(__file__).resolve().parents[2] / "scenes" / "tgv-tf.toml"

SPACE = ParameterSpace((Parameter("Re", 1500.0, 2500.0), Parameter("time", 0.0, 2.0, "s")))
FUNCTION = TransferFunction(
    ((-1, 0, 0, 1), (3, 1, 0, 0)),
    ((-1, 0), (0.5, 0.2), (1.5, 0.5), (3, 1)),
    0.3,
)
BASE = VolumeRendering("dvr", FUNCTION)
FUNCTIONS = transfer_function_family(BASE, first_step=(0.25, 0.1), second_step=(0.5, 0.25))
SURFACES = isovalue_family("dvr", train=np.linspace(0.0, 1.0, 40).tolist())
CAMERAS = tuple(orbit((0, 0, 0), 1.0, width=256, height=256))
PLAN = CatalogPlan(
    space=SPACE,
    appearances=(BASE, *FUNCTIONS.appearances, *SURFACES.appearances),
    cameras=CAMERAS,
    view_splits=tuple(view_splits(252)),
    bounds=((-1, -1, -1), (1, 1, 1)),
    variations=(FUNCTIONS.variation, SURFACES.variation),
)
PARAMETERS = {"Re": 1500.0, "time": 0.25}
MEMBER = Member("a", PARAMETERS, "train", CAMERAS, PLAN.view_splits, Path("a"), {}, tuple(PLAN.appearance_names))
FRAME = Frame(Path("train/r_0.png"), "train", CAMERAS[0], (0.1, 0.2), False)
SUMMARY = FieldSummary(
    -1.0, 3.0, 0.02, np.zeros(256, int), np.zeros(257), np.zeros((9, 3), np.float32), *np.zeros((2, 9), np.float32)
)
SHOWN: list[tuple[Any, str]] = [
    (Parameter("Re", 1500.0, 2500.0), "Re"),
    (Splits({"a": "train"}, 9), "9"),
    (MissingMember("a", PARAMETERS, "ValueError: bad"), "ValueError: bad"),
    (Quantity("Q", "1/s²"), "1/s²"),
    (Digests({"dvr": 16 * 252 * "0"}, {"field.npz": 16 * "0"}), "<Digests of 252 images, field.npz>"),
    (SPACE, "<ParameterSpace of Re in [1500, 2500], time in [0, 2] s>"),
    (CAMERAS[0], "256x256 pixels"),
    (FUNCTION, "<TransferFunction over [-1, 3]: 2 colour and 4 opacity points>"),
    (BASE, "dvr"),
    (Isosurface("iso", 0.5), "0.5"),
    (ImportedImages("imported"), "imported"),
    (MissingAppearance("middle", '{"kind": "slice"}'), "slice"),
    (VariationSetting("dvr-1", (0.1, 0.2, 0.3, 0.4), "train"), "dvr-1"),
    (FUNCTIONS, "transfer_function of dvr"),
    (FUNCTIONS.variation, "104 settings (76 train, 8 validation, 20 test), c1_value in [-0.25, 0.25]"),
    (SURFACES.variation, "isovalue of dvr: 40 settings"),
    (field_variation("dvr", appearances=["speed-dvr"]), "<FieldVariation: field: dvr, or speed-dvr>"),
    (PLAN, "252 views of dvr, dvr-train-01"),
    (MEMBER, "<Member a (train): Re=1500 time=0.25; 252 views of dvr, dvr-train-01"),
    (SUMMARY, "<FieldSummary from -1 to 3, 2.00 % clipped, 9 points by opacity, 0 evenly>"),
    (
        CoarseField(np.zeros((4, 3, 2)), (1, 1, 1), (0, 0, 0), True),
        "<CoarseField of 2 x 3 x 4 samples, the field's own, 16 bits>",
    ),
    (Sizes(127_000_000, 7_800_000, 252, True), "127 MB of images, 7.8 MB of fields"),
    (PlannedMember("a", PARAMETERS, "train", MEMBER.appearances), "<PlannedMember a (train): Re=1500"),
    (ViewPlan(), "256"),
    (VariedMembers(FUNCTIONS.variation), "transfer_function of dvr"),
    (RenderPlan(), "50"),
    (Scene.load(SCENE), "<Scene tgv-tf: "),
    (FRAME, "r_0.png"),
    (ImportedMember("a", (0.1, 0.2), "train", (FRAME,) * 100, ("train",) * 100), "a"),
    (CardImage(np.zeros((64, 64, 3), np.uint8), "below"), "below"),
    (selection.SelectedImage(MEMBER, 3, "train"), "view=3"),
    (selection.Selection(Catalog(Path("flow.cdb"), PLAN), (MEMBER,) * 1000, "dvr"), "(1000 in all) of flow.cdb, dvr"),
    (PngHeader(8, 6, 8, 2, False), "8"),
    (Stamps(7, Stamp(1, 2, 3)), "Stamp(inode=1, size=2, changed=3)"),
    (Finding("data.csv", "is missing"), "is missing"),
    (Merged(12, 3, 0), "added=12"),
    (Shard("shard-0", ("a",) * 1000, 2000, ((0.0, 1.0),)), "<Shard shard-0: 1000 members, 2000 rows>"),
    (Transferred(12, 3, 0), "made=12"),
    (ExpectedImage(192, 256), "height=192"),
    (Pack(Path("pictures.h5"), 192, 256, "uint8", np.zeros(504, ENTRY)), "504 images of 256x192, uint8"),
    (SetAside("a", Path("damaged/a"), ("dvr/000.png is missing",), PARAMETERS), "dvr/000.png is missing"),
    (Repaired((), (Finding("data.csv", "is missing"),)), "is missing"),
    (Access("0.0.0.0", "secret"), "0.0.0.0"),
    (Count("drawing", 1, 2, 0.5), "drawing"),
    (doctor.Finding("kernels", "avx512"), "avx512"),
    (doctor.Package("vtk", "insitu", "9.5.2", "9.3"), "9.5.2"),
    (doctor.PROBES[0], "kernels"),
]


@pytest.mark.parametrize(("shown", "words"), SHOWN, ids=lambda value: type(value).__name__)
def test_a_repr_is_one_line(shown: Any, words: str) -> None:
    assert words in repr(shown)
    assert len(repr(shown).splitlines()) == 1
    assert len(repr(shown)) <= LONGEST


def test_a_catalog_is_one_line(catalog: Catalog) -> None:
    assert len(repr(catalog).splitlines()) == 1
    assert "12 views of dvr, iso" in repr(catalog)


def test_a_token_is_not_printed() -> None:
    assert "secret" not in repr(Access("0.0.0.0", "secret"))


def test_every_public_dataclass_is_in_the_table() -> None:
    modules = [
        importlib.import_module(m.name)
        for m in pkgutil.walk_packages(catalogs.__path__, "catalogs.")
        if ".engines" not in m.name
    ]
    public = {
        value
        for module in modules
        for name, value in vars(module).items()
        if not name.startswith("_") and dataclasses.is_dataclass(value) and isinstance(value, type)
    }
    known = {form for shown, _ in SHOWN for form in type(shown).__mro__}
    assert {form.__name__ for form in public - known} == set()
