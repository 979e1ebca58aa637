"""Training begins with the emulator of the coarse fields, compares it with the Gaussians, and says which draws better."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import ImportedImages, TransferFunction
from catalogs.vocabulary.cameras import Camera
from surrogate.cli import main
from surrogate.evaluation.predictor import pictures_of_all
from surrogate.model import FieldModel, Surrogate
from surrogate.model.representation import BOTH, FIELD, GAUSSIANS
from surrogate.settings import TrainingSettings
from surrogate.training.emulator import fit, lacking
from surrogate.training.other_functions import number_of_pictures, other_functions, scores_under_other_functions
from surrogate.training.run import train
from surrogate.training.source import MOST_ERROR, Source
from tests.support.field_catalogs import rendered

SETTINGS = TrainingSettings(gaussians=60, canonical_steps=4, deformation_steps=8, visualization_steps=6)
WORDS = [f"{key}={value}" for key, value in SETTINGS.to_json().items() if key.endswith("steps") or key == "gaussians"]


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return rendered(tmp_path_factory.mktemp("catalog") / "a.cdb", surface=False)


@pytest.mark.slow
def test_the_command_stops_after_the_field_and_goes_on(catalog: Catalog, tmp_path: Path) -> None:
    arguments = ["train", str(catalog.path), "-o", str(tmp_path / "run"), *WORDS]
    first = CliRunner().invoke(main, [*arguments, "--model", "field"])
    assert first.exit_code == 0, first.output
    assert "drawn from its emulated field: " in first.output
    folder = tmp_path / "run" / "surrogate"
    assert Surrogate.load(folder).representations == (FIELD,)
    again = CliRunner().invoke(main, [*arguments, "--model", "field"])
    assert "nothing to do" in again.output
    whole = CliRunner().invoke(main, arguments)
    assert whole.exit_code == 0, whole.output
    assert "drawn best from its emulated field: " in whole.output
    assert "as the mean image of Gaussians and field: " in whole.output
    surrogate = Surrogate.load(folder)
    assert surrogate.representations == (GAUSSIANS, FIELD, BOTH)
    scores = json.loads((folder / "representations.json").read_text())
    assert set(scores["psnr"]["view"]) == {GAUSSIANS, FIELD, BOTH}
    assert set(scores["psnr"]["transfer_function"]) == {GAUSSIANS, FIELD, BOTH}
    shown = CliRunner().invoke(main, ["show", str(tmp_path / "run")])
    assert "drawn best from its emulated field: " in shown.output


def test_without_validation_members_left_out_ones_are_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.support.field_catalogs.VALIDATED", ())
    catalog = rendered(tmp_path / "a.cdb", surface=False)
    arguments = ["train", str(catalog.path), "-o", str(tmp_path / "run"), "--model", "field", "--steps", "5"]
    output = CliRunner().invoke(main, arguments).output
    assert " dB on left-out members, " in output
    assert "validation images" not in output
    assert Surrogate.load(tmp_path / "run" / "surrogate").scores.left_out


def test_gaussians_start_from_the_field(catalog: Catalog, tmp_path: Path) -> None:
    surrogate = train(replace(SETTINGS, fit_to_need=False), catalog, tmp_path)
    assert surrogate.deformation.emulated is not None
    loaded = Surrogate.load(tmp_path)
    assert loaded.deformation.emulated is not None
    camera = catalog.plan.cameras[0]
    pictures = [s.using(GAUSSIANS).at(p=0.4).render(camera) for s in (surrogate, loaded)]
    np.testing.assert_array_equal(*pictures)
    elsewhere = train(replace(SETTINGS, initialization="random"), catalog, tmp_path / "random")
    assert elsewhere.deformation.emulated is None


def test_every_representation_is_drawn_as_by_itself_and_each_once(catalog: Catalog, tmp_path: Path) -> None:
    surrogate, camera = train(replace(SETTINGS, fit_to_need=False), catalog, tmp_path), catalog.plan.cameras[0]
    for background in (None, (0.2, 0.4, 0.6)):
        member = surrogate.using(surrogate.representations[-1]).at(p=0.4)
        pictures = pictures_of_all(member, camera, background)
        for name, picture in zip(surrogate.representations, pictures, strict=True):
            alone = surrogate.using(name).at(p=0.4).render(camera, background=background)
            np.testing.assert_array_equal(picture, alone)
    [alone] = pictures_of_all(surrogate.using(FIELD).at(p=0.4), camera)
    np.testing.assert_array_equal(alone, surrogate.using(FIELD).at(p=0.4).render(camera))


def test_gaussians_that_carry_colours_have_no_score_under_other_functions(catalog: Catalog, tmp_path: Path) -> None:
    surrogate = train(replace(SETTINGS, fit_to_need=False, carried="colors"), catalog, tmp_path)
    assert set(surrogate.scores.psnr["view"]) == {GAUSSIANS, FIELD, BOTH}
    assert set(scores_under_other_functions(surrogate, catalog)) == {FIELD}


@pytest.mark.parametrize(("side", "count"), [(16, 48), (512, 48), (724, 24), (1024, 12), (4096, 12)])
def test_fewer_large_pictures_are_compared(side: int, count: int) -> None:
    camera = Camera.look_at((0.4, -3.0, 0.7), (0, 0, 0), vertical_fov_degrees=40.0, width=side, height=side)
    assert number_of_pictures(camera, 48, 12) == count


def test_catalogs_without_fields_are_trained_as_ever(tmp_path: Path) -> None:
    bare = rendered(tmp_path / "bare.cdb", coarse_field=False, surface=False)
    assert "none of 5 members to learn from keep a coarse field: `insitu dataset`" in lacking(Source(SETTINGS, bare))
    surrogate = train(SETTINGS, bare, tmp_path / "run")
    assert surrogate.field is None
    assert not FieldModel.exists(tmp_path / "run")
    with pytest.raises(ValueError, match=r"bare.cdb: none of 5 members"):
        train(SETTINGS, bare, tmp_path / "other", only_field=True)
    with pytest.raises(ValueError, match="this surrogate knows no field values"):
        surrogate.at(p=0.5).sample([[0.0, 0.0, 0.0]])


def test_pictures_of_another_program_have_no_field() -> None:
    source = SimpleNamespace(target=ImportedImages("pictures"), appearance="pictures")
    assert lacking(source) == "pictures shows pictures of another program, of which no field is known"  # type: ignore[arg-type]


def test_the_emulator_of_another_run_is_not_mixed_in(catalog: Catalog, tmp_path: Path) -> None:
    train(SETTINGS, catalog, tmp_path, only_field=True)
    with pytest.raises(ValueError, match="holds the emulator of another run"):
        train(replace(SETTINGS, seed=1), catalog, tmp_path)


def test_other_functions_cover_the_values() -> None:
    base = TransferFunction(((-2.0, 0.0, 0.0, 0.0), (6.0, 1.0, 1.0, 1.0)), ((-2.0, 0.5), (6.0, 0.5)), 0.7)
    for values in (np.full(5, 3.0), np.array([-50.0, -50.0, 1.0]), np.array([90.0])):
        rising, falling, peak = other_functions(base, values)
        assert rising.opacities([-2.0, 2.0, 6.0]).tolist() == pytest.approx([0.0, 0.3, 0.6])
        assert falling.opacities([-2.0, 6.0]).tolist() == pytest.approx([0.6, 0.0])
        places = np.linspace(-2.0, 6.0, 801)
        assert peak.opacities(places).max() == pytest.approx(0.6, abs=0.02)
        assert float((peak.opacities(places) > 0.0).mean()) == pytest.approx(0.1, abs=0.01)
        assert all(f.opacity_unit_distance == 0.7 for f in (rising, falling, peak))


def test_a_field_that_is_predicted_poorly_is_no_start(catalog: Catalog) -> None:
    source = Source(SETTINGS, catalog)
    model = fit(source, "")
    assert source.start_from_field(model) is not None
    [(name, emulator)] = model.emulators.items()
    poor = replace(emulator, errors=np.full_like(emulator.errors, 1.01 * MOST_ERROR * emulator.spread))
    assert source.start_from_field(replace(model, emulators=replace(model.emulators, emulators={name: poor}))) is None
