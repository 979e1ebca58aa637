"""Pictures under functions that no catalog holds: of the same field, from the same views, rendered once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.store.splits import Splits
from catalogs.vocabulary.scene import Scene
from research.benchmarks.training.functions.__main__ import base_of, functions_of
from research.benchmarks.training.functions.departures import TRAINED
from research.benchmarks.training.functions.truth import FOLDER, TruthRequest, truth
from surrogate.evaluation.metrics import score
from surrogate.evaluation.novelty import SeenValues
from tests.support.again import made, rendered, scene_file


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Catalog, Path]:
    folder = tmp_path_factory.mktemp("again")
    scene = scene_file(folder)
    return Scene.load(scene), rendered(scene, folder / "runs"), folder / "runs" / "again"


def wanted(run: tuple[Scene, Catalog, Path], members: int, views: int) -> TruthRequest:
    scene, catalog, _ = run
    surrogate = made(catalog)
    base = base_of(catalog, surrogate)
    functions = functions_of(scene, base, SeenValues.of_training(catalog, surrogate))
    return TruthRequest.of(scene, catalog, base, functions, members, views)


def test_the_pictures_are_of_the_stored_field_under_the_function_asked_for(run) -> None:
    _, catalog, folder = run
    asked = wanted(run, 2, 2)
    found = truth(asked, folder)
    assert [m.name for m in found.members] == [m.name for m in asked.members] == ["test-000", "test-002"]
    assert all(catalog.plan.view_splits[view] == "test" for view in asked.views)
    for member in found.members:
        for place, view in enumerate(asked.views):
            pictures = {a: found.image(member, a, place).astype(float) / 255.0 for a in found.appearance_names}
            stored, trained = catalog.image(member.name, "dvr", view), found.image(member, TRAINED, place)
            assert score(stored, trained, None).psnr > 45.0  # as exact as the scene asks for
            turned = pictures["colours"][..., [1, 2, 0, 3]]  # of which (b, r, g) is (r, g, b) again
            np.testing.assert_allclose(turned, pictures[TRAINED], atol=0.02)
            covered = pictures[TRAINED][..., 3]
            assert covered.max() > 0.1
            assert (pictures["half"][..., 3] <= covered + 0.01).all()
            assert (pictures["double"][..., 3] >= covered - 0.01).all()
            assert (pictures["high"][..., 3] <= covered + 0.01).all()


@pytest.mark.slow
def test_only_what_is_missing_is_rendered(run) -> None:
    _, _, folder = run
    first = truth(wanted(run, 1, 2), folder)
    [only] = [path for path in (first.path / "members").iterdir() if path.name == "test-000"]
    before, said = only.stat().st_mtime_ns, list[str]()
    more = truth(wanted(run, 3, 2), folder, said.append)
    assert more.path == first.path
    assert len(more.members) == 3
    assert only.stat().st_mtime_ns == before
    assert not any("test-000" in line for line in said)
    assert truth(wanted(run, 3, 1), folder).path != first.path  # other views, other pictures
    assert len(list((folder / FOLDER).iterdir())) == 2


def test_a_scene_without_fields_or_test_members_is_refused_before_anything_is_written(run, tmp_path: Path) -> None:
    scene, catalog, _ = run
    base = base_of(catalog, made(catalog))
    elsewhere = tmp_path / "b.toml"
    elsewhere.write_text('name = "b"\n[source]\nkind = "catalog"\npath = "x.cdb"\n')
    untested = catalog.with_splits(Splits({member.name: "train" for member in catalog.members}))
    for of, known, message in ((Scene.load(elsewhere), catalog, "has no fields"), (scene, untested, "0 test members")):
        with pytest.raises(ValueError, match=message):
            TruthRequest.of(of, known, base, {}, 1, 1)
