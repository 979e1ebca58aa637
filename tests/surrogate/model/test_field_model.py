"""An ensemble drawn from its emulated field: any parameters, views, transfer functions and isovalues, through one face."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import render
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from render import Grid, render_views
from surrogate.model import DeformedGaussians, EmulatedMember, MeanMember, Surrogate
from surrogate.model.representation import BOTH, FIELD, GAUSSIANS, RepresentationScores
from surrogate.settings import TrainingSettings
from surrogate.training.run import train
from tests.support.field_catalogs import SIZE, field, rendered

assert render
SETTINGS = TrainingSettings(gaussians=60, canonical_steps=4, deformation_steps=8, visualization_steps=6)
OTHER = TransferFunction(((0.0, 1.0, 1.0, 0.0), (1.0, 0.0, 0.0, 1.0)), ((0.1, 0.0), (0.5, 0.7), (0.6, 0.1)), 0.3)
P = 0.4


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return rendered(tmp_path_factory.mktemp("catalog") / "a.cdb")


@pytest.fixture(scope="module")
def folder(catalog: Catalog, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "surrogate"
    train(SETTINGS, catalog, path)
    return path


@pytest.fixture(scope="module")
def surrogate(folder: Path) -> Surrogate:
    return Surrogate.load(folder)


def decibels(picture: np.ndarray, truth: np.ndarray) -> float:
    return float(-10.0 * np.log10(np.mean((picture - truth) ** 2) + 1e-12))


def true_picture(catalog: Catalog, p: float, appearance: VolumeRendering | Isosurface, view: int = 3) -> np.ndarray:
    """The image of `render` of the field at p, (H, W, 4) in [0, 1]."""
    grid = Grid(field(p), (1.1 / (SIZE - 1),) * 3)
    distance = catalog.plan.provenance["sample_distances"]["dvr"]
    options = {"sample_distance": distance} if isinstance(appearance, VolumeRendering) else {}
    [picture] = render_views(grid, appearance, [catalog.plan.cameras[view]], **options)
    return np.asarray(picture, dtype=np.float64) / 255.0


def test_the_better_representation_draws(surrogate: Surrogate, catalog: Catalog) -> None:
    assert surrogate.representations == (GAUSSIANS, FIELD, BOTH)
    scores = surrogate.scores.psnr["view"]
    assert scores[FIELD] > scores[GAUSSIANS] + 5.0
    member = surrogate.at(p=P)
    assert isinstance(member, EmulatedMember)
    base = catalog.plan.appearances[0]
    assert isinstance(base, VolumeRendering)
    assert decibels(member.render(catalog.plan.cameras[3]), true_picture(catalog, P, base)) > 45.0


def test_any_function_and_isovalue_is_drawn(surrogate: Surrogate, catalog: Catalog) -> None:
    field_alone, camera = surrogate.using(FIELD), catalog.plan.cameras[3]
    base = catalog.plan.appearances[0]
    assert isinstance(base, VolumeRendering)
    under = field_alone.under(OTHER, p=P).render(camera)
    assert decibels(under, true_picture(catalog, P, replace(base, transfer_function=OTHER))) > 45.0
    surface = field_alone.at(p=P, isovalue=0.33)
    assert isinstance(surface, EmulatedMember)
    assert surface.appearance.isovalue == 0.33  # type: ignore[union-attr]
    assert decibels(surface.render(camera), true_picture(catalog, P, Isosurface("x", 0.33))) > 25.0


def test_one_face_whatever_draws(surrogate: Surrogate, catalog: Catalog) -> None:
    camera, background = catalog.plan.cameras[5], (1.0, 0.5, 0.0)
    for name, kind in ((GAUSSIANS, DeformedGaussians), (FIELD, EmulatedMember), (BOTH, MeanMember)):
        drawn = surrogate.using(name)
        member = drawn.at(p=P)
        assert isinstance(member, kind)
        picture = member.render(camera, background=background)
        batch = drawn.render([[P], [0.9]], camera, background=background)
        np.testing.assert_array_equal(batch[0], picture)
        assert picture.shape == (16, 16, 4)
        assert (picture[..., 3] == 1.0).all()
        values, deviations = member.sample([[0.55, 0.55, 0.55], [9.0, 0.0, 0.0]])
        assert values[0] == pytest.approx(float(np.mean(field(P)[5:7, 5:7, 5:7])), rel=0.02)
        assert deviations[0] > 0.0
        assert np.isnan(values[1])
        assert member.field().values.shape == (SIZE,) * 3
        assert repr(member).startswith(f"<{kind.__name__} at p=0.4: ")
        assert "svg" in member._repr_html_() or "img" in member._repr_html_()
        with pytest.warns(UserWarning, match="p = 1.2 lies outside its bounds"):
            drawn.at(p=1.2)
        with pytest.raises(ValueError, match="unknown"):
            drawn.at(p=P, q=1.0)
    both = surrogate.using(BOTH).at(p=P).render(camera)
    each = [surrogate.using(name).at(p=P).render(camera) for name in (GAUSSIANS, FIELD)]
    np.testing.assert_allclose(both, (each[0] + each[1]) / 2.0, atol=1e-7)


@pytest.mark.parametrize("name", [GAUSSIANS, FIELD, BOTH])
def test_batches_are_drawn_by_any(surrogate: Surrogate, catalog: Catalog, name: str) -> None:
    drawn, cameras = surrogate.using(name), list(catalog.plan.cameras[:4])
    places = [0.1, 0.4, 0.7, 1.0]
    for batch, expected in (
        (drawn.render({"p": places}, cameras), [drawn.at(p=p) for p in places]),
        (drawn.render({"p": P}, cameras), [drawn.at(p=P)] * 4),
        (drawn.render({"p": places, "isovalue": 0.3}, cameras), [drawn.at(p=p, isovalue=0.3) for p in places]),
        (drawn.render({"p": places}, cameras, transfer_function=OTHER), [drawn.under(OTHER, p=p) for p in places]),
    ):
        single = [member.render(camera) for member, camera in zip(expected, cameras, strict=True)]
        np.testing.assert_array_equal(batch, single)


def test_stored_copied_and_pickled_it_stays_the_same(surrogate: Surrogate, tmp_path: Path, catalog: Catalog) -> None:
    surrogate.save(tmp_path)
    camera = catalog.plan.cameras[0]
    for other in (Surrogate.load(tmp_path), pickle.loads(pickle.dumps(surrogate))):
        assert other.digest == surrogate.digest
        assert other.scores == surrogate.scores
        for name in surrogate.representations:
            expected = surrogate.using(name).at(p=P).render(camera)
            np.testing.assert_array_equal(other.using(name).at(p=P).render(camera), expected)
    assert surrogate.using(FIELD).digest != surrogate.using(GAUSSIANS).digest


def test_a_field_without_gaussians_is_a_surrogate(folder: Path, tmp_path: Path, surrogate: Surrogate) -> None:
    import shutil

    shutil.copytree(folder / "field", tmp_path / "field")
    alone = Surrogate.load(tmp_path)
    assert alone.representations == (FIELD,)
    assert "Gaussians" not in repr(alone)
    assert alone.visualization_names == ("isovalue",)
    np.testing.assert_array_equal(alone.at(p=P).field().values, surrogate.at(p=P).field().values)
    with pytest.raises(ValueError, match="can be drawn by its field alone, got 'gaussians'"):
        alone.using(GAUSSIANS)


def test_damage_is_named(folder: Path, tmp_path: Path) -> None:
    import shutil

    for number, (name, change, message) in enumerate(
        [
            ("representations.json", b"{", "representations.json is damaged"),
            (
                "representations.json",
                b'{"psnr": {"view": {"field": NaN}}, "megabytes": {}, "milliseconds": {}}',
                "damaged",
            ),
            ("field/model.json", b"[]", "it is not a JSON object"),
            ("field/model.safetensors", b"12345678", "its header is cut off"),
        ]
    ):
        copy = tmp_path / str(number)
        shutil.copytree(folder, copy)
        (copy / name).write_bytes(change)
        with pytest.raises(ValueError, match=message):
            Surrogate.load(copy)


def test_scores_choose_and_gaussians_are_the_default() -> None:
    assert RepresentationScores().better("view") == GAUSSIANS
    assert RepresentationScores({"view": {FIELD: 30.0, GAUSSIANS: 31.0, BOTH: 32.0}}).better("view") == BOTH
    assert RepresentationScores({"view": {FIELD: 30.0, GAUSSIANS: 30.0}}).better("view") == GAUSSIANS
