"""A tour of the whole product in seconds, on a field of two blobs: the first file to read.

field -> hook -> catalog -> training -> a picture at parameters that were never simulated.
"""

from __future__ import annotations

import numpy as np
import pytest

import insitu
from catalogs import Catalog, TransferFunction, VolumeRendering
from catalogs.tools.check import check
from catalogs.vocabulary.scene import ViewPlan
from surrogate import Surrogate, TrainingSettings, train
from surrogate.evaluation.metrics import psnr

SPACING = 2.0 / 23


def simulate(separation: float) -> np.ndarray:
    """A "simulation": two Gaussian blobs, `separation` apart along x, on 24^3 points of the box [-1, 1]^3; (z, y, x)."""
    z, y, x = np.meshgrid(*[np.linspace(-1.0, 1.0, 24)] * 3, indexing="ij")
    blobs = [np.exp(-((x - s * separation / 2) ** 2 + y**2 + z**2) / 0.06) for s in (-1, 1)]
    return (blobs[0] + blobs[1]).astype(np.float32)


# How it is to look: fixed before the first member, in the field's own units.
APPEARANCE = VolumeRendering(
    "dvr",
    TransferFunction(
        color_points=((0.1, 0.1, 0.3, 0.8), (0.6, 0.9, 0.8, 0.3), (1.2, 0.8, 0.1, 0.1)),
        opacity_points=((0.1, 0.0), (1.0, 0.8)),
        opacity_unit_distance=0.3,
    ),
)


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    """1. The hook in a simulation's loop: each field is rendered from all sides and may then be forgotten."""
    path = tmp_path_factory.mktemp("tour") / "blobs.cdb"
    members = {0.6: "train", 0.8: "train", 1.0: "train", 0.75: "validation", 0.9: "test"}
    for separation, split in members.items():
        rendered = insitu.render_member(
            simulate(separation),
            {"separation": separation},
            catalog=path,
            space={"separation": (0.6, 1.0)},
            appearances=APPEARANCE,
            views=ViewPlan(frequency=2, width=48, height=48),
            spacing=(SPACING,) * 3,
            origin=(-1.0,) * 3,
            split=split,
        )
        assert rendered.images == 42  # viewpoints of an icosphere of frequency 2; the product's is 5, with 252
    return Catalog.open(path)


@pytest.fixture(scope="module")
def surrogate(catalog: Catalog) -> Surrogate:
    """3. Gaussians are fitted to the pictures, and learn how the parameter moves them."""
    settings = TrainingSettings(gaussians=300, canonical_steps=200, deformation_steps=600, validation_interval=0)
    return train(settings, catalog, catalog.path.parent / "surrogate")


def test_the_catalog_is_a_cinema_database_and_keeps_what_the_fields_knew(catalog: Catalog) -> None:
    """2. What lies on disk: a table, pictures, and a few kilobytes about each field."""
    assert check(catalog.path) == []
    member = catalog.member(catalog.members[0].name)
    picture = catalog.image(member, "dvr", 5)
    assert picture.shape == (48, 48, 4)
    assert picture[..., 3].max() > 50  # there is something to see
    kept = member.summary()
    assert kept is not None
    assert len(kept.points) > 1000  # sampled where the field was opaque: the Gaussians start there


@pytest.mark.slow
def test_the_surrogate_shows_parameters_that_were_never_simulated(catalog: Catalog, surrogate: Surrogate) -> None:
    """4. Any view, any parameter, in milliseconds."""
    deformed = surrogate.at(separation=0.9)
    (unseen,) = [m for m in catalog.members if m.split == "test"]
    scores, still = [], []
    for view, split in enumerate(unseen.view_splits):
        if split != "test":
            continue
        truth = catalog.image(unseen, "dvr", view, dtype="float32")
        scores.append(psnr(truth, deformed.render(unseen.cameras[view])))
        still.append(psnr(truth, surrogate.at(separation=0.6).render(unseen.cameras[view])))
    assert np.mean(scores) > 32.0
    assert np.mean(scores) > np.mean(still) + 4.0  # and it is the parameter that does it


def test_it_is_kept_and_found_again(catalog: Catalog, surrogate: Surrogate) -> None:
    """5. A model is two small files, tensors and JSON; loading one never runs code from it."""
    found = Surrogate.load(catalog.path.parent / "surrogate")
    camera = catalog.plan.cameras[3]
    assert np.array_equal(found.at(separation=0.7).render(camera), surrogate.at(separation=0.7).render(camera))
    assert "separation" in repr(found)
