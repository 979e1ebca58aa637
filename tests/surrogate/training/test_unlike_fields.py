"""Ensembles whose coarse fields no emulator can learn together are trained from their pictures, as those without any."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import insitu
from catalogs.store.catalog import Catalog
from catalogs.store.coarse import save_coarse_fields
from catalogs.store.members import COARSE
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import ViewPlan
from catalogs.vocabulary.variations.field import field_variation
from surrogate.cli import main
from surrogate.emulation import EmulatedFields
from surrogate.model import Surrogate
from surrogate.model.representation import BOTH, FIELD, GAUSSIANS
from surrogate.settings import TrainingSettings
from surrogate.training.emulator import NoEmulator, lacking
from surrogate.training.run import train
from surrogate.training.source import Source
from tests.support.hooked import FUNCTION, blob

pytestmark = pytest.mark.filterwarnings("ignore:.*:UserWarning")
SETTINGS = TrainingSettings(gaussians=60, canonical_steps=0, deformation_steps=8, visualization_steps=6)
BASE = VolumeRendering("dvr", FUNCTION)
SPLITS = ("train", "train", "validation", "train", "train")
SIDE = 13


def catalog_of(
    path: Path,
    fields: Sequence[NDArray[np.floating]],
    size: float = 1.0,
    shift: float = 0.0,
    shown: VolumeRendering = BASE,
    splits: Sequence[str] = SPLITS,
) -> Catalog:
    """Members whose fields fill a box of a size; the second one's ends by `shift` sooner and begins so much later."""
    space = ParameterSpace((Parameter("p", 0.0, 1.0),))
    views = ViewPlan(frequency=1, width=16, height=16)
    with insitu.Session(path, space=space, appearances=[shown], views=views) as session:
        for i, (field, split) in enumerate(zip(fields, splits, strict=True)):
            inside = shift * size if i == 1 else 0.0
            spacing = (size - 2.0 * inside) / (len(field) - 1)
            place = {"spacing": (spacing,) * 3, "origin": (inside,) * 3}
            session.render_member(field, {"p": i / 4}, split=split, **place)
    return Catalog.open(path)


def grown(i: int, side: int = SIDE) -> NDArray[np.floating]:
    return blob(size=side) * (0.7 + 0.1 * i)


@pytest.mark.parametrize(
    "size", [pytest.param(1e-9, marks=pytest.mark.slow), 1.0, pytest.param(1e9, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(("side", "shift"), [(7, 0.0), (SIDE, 0.02)])
def test_fields_on_unlike_lattices_are_trained_from_pictures(
    tmp_path: Path, size: float, side: int, shift: float
) -> None:
    fields = [grown(i, side if i == 1 else SIDE) for i in range(5)]
    catalog = catalog_of(tmp_path / "a.cdb", fields, size, shift)
    assert train(SETTINGS, catalog, tmp_path / "run").representations == (GAUSSIANS,)
    with pytest.raises(NoEmulator, match=r"a\.cdb: the coarse field .* an emulator needs one grid for all members"):
        train(SETTINGS, catalog, tmp_path / "other", only_field=True)


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_fields_of_any_size_are_emulated(tmp_path: Path, size: float) -> None:
    catalog = catalog_of(tmp_path / "a.cdb", [grown(i) for i in range(5)], size)
    assert len(EmulatedFields.fit(catalog)) == 1


def test_the_command_says_why(tmp_path: Path) -> None:
    catalog = catalog_of(tmp_path / "a.cdb", [grown(i, 7 if i == 1 else SIDE) for i in range(5)])
    words = [f"{key}={value}" for key, value in SETTINGS.to_json().items() if key.endswith("steps")]
    done = CliRunner().invoke(main, ["train", str(catalog.path), "-o", str(tmp_path / "run"), "gaussians=60", *words])
    assert done.exit_code == 0, done.output
    assert "no emulated field: " in done.output
    assert done.output.count("an emulator needs one grid for all members") == 1


@pytest.mark.slow
def test_all_that_is_learnt_must_be_emulated(tmp_path: Path) -> None:
    space = ParameterSpace((Parameter("p", 0.0, 1.0),))
    shown = [VolumeRendering("one", FUNCTION, field="one"), VolumeRendering("two", FUNCTION, field="two")]
    variation = field_variation("one", appearances=["two"])
    path, views = tmp_path / "a.cdb", ViewPlan(frequency=1, width=16, height=16)
    with insitu.Session(path, space=space, appearances=shown, views=views, variations=[variation]) as session:
        for i, split in enumerate(SPLITS):
            fields = {"one": grown(i), "two": grown(4 - i)}
            session.render_member(fields, {"p": i / 4}, spacing=(1.0 / 12,) * 3, split=split)
    catalog = Catalog.open(path)
    whole = train(SETTINGS, catalog, tmp_path / "run")
    assert set(whole.scores.psnr) >= {"view", "field"}
    assert whole.using(FIELD).at(p=0.4, appearance="two").render(catalog.plan.cameras[0]).any()
    for member in catalog.members:
        save_coarse_fields(member.path / COARSE, {"one": member.coarse_fields()["one"]})
    assert "none of 4 members to learn from keep a coarse field of two: " in lacking(Source(SETTINGS, catalog))
    assert train(SETTINGS, catalog, tmp_path / "other").representations == (GAUSSIANS,)


@pytest.mark.slow
def test_a_field_that_is_not_shown_prevents_no_emulator(tmp_path: Path) -> None:
    space = ParameterSpace((Parameter("p", 0.0, 1.0),))
    shown = [VolumeRendering("one", FUNCTION, field="one"), VolumeRendering("two", FUNCTION, field="two")]
    path, views = tmp_path / "a.cdb", ViewPlan(frequency=1, width=16, height=16)
    with insitu.Session(path, space=space, appearances=shown, views=views) as session:
        for i, split in enumerate(SPLITS):
            session.render_member(
                {"one": grown(i), "two": grown(i)}, {"p": i / 4}, spacing=(1.0 / 12,) * 3, split=split
            )
    catalog = Catalog.open(path)
    member = catalog.members[1]
    coarse = member.coarse_fields()
    moved = replace(coarse["two"], origin=(0.3, 0.0, 0.0))
    save_coarse_fields(member.path / COARSE, {"one": coarse["one"], "two": moved})
    words = [f"{key}={value}" for key, value in SETTINGS.to_json().items() if key.endswith("steps")]
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        done = CliRunner().invoke(main, ["train", str(path), "-o", str(tmp_path / "run"), "gaussians=60", *words])
    assert done.exit_code == 0, done.output
    assert done.output.count("Warning: a field that no appearance shows is left out: the coarse field 'two' of ") == 1
    surrogate = Surrogate.load(tmp_path / "run" / "surrogate")
    assert surrogate.representations == (GAUSSIANS, FIELD, BOTH)
    assert surrogate.field is not None
    assert list(surrogate.field.emulators) == ["one"]
    with pytest.raises(NoEmulator, match="the coarse field 'two' of "):
        train(replace(SETTINGS, appearance="two"), catalog, tmp_path / "other", only_field=True)


@pytest.mark.parametrize("offset", [1e6, -1e9])
def test_fields_that_32_bits_do_not_tell_apart_are_trained_from_pictures(tmp_path: Path, offset: float) -> None:
    fields = [offset + 1e-3 * grown(i).astype(np.float64) for i in range(5)]
    ends = offset, offset + 1.2e-3
    function = TransferFunction(tuple((v, 1.0, 0.5, 0.0) for v in ends), ((ends[0], 0.0), (ends[1], 0.8)), 0.1)
    catalog = catalog_of(tmp_path / "a.cdb", fields, shown=VolumeRendering("dvr", function))
    assert train(SETTINGS, catalog, tmp_path / "run").representations == (GAUSSIANS,)
    with pytest.raises(NoEmulator, match=r"the fields span 0\.001.*, which numbers of 32 bits hardly tell apart"):
        train(SETTINGS, catalog, tmp_path / "other", only_field=True)


@pytest.mark.slow
def test_a_finished_run_whose_catalog_got_fields_gets_their_emulator_alone(tmp_path: Path) -> None:
    catalog = catalog_of(tmp_path / "a.cdb", [grown(i) for i in range(5)])
    files = {member.path / COARSE: (member.path / COARSE).read_bytes() for member in catalog.members}
    for file in files:
        file.unlink()
    words = [f"{key}={value}" for key, value in SETTINGS.to_json().items() if key.endswith("steps")]
    command = ["train", str(catalog.path), "-o", str(tmp_path / "run"), "gaussians=60", *words]
    assert CliRunner().invoke(main, command).exit_code == 0
    trained = (tmp_path / "run" / "surrogate" / "model.safetensors").read_bytes()
    for file, content in files.items():
        file.write_bytes(content)
    again = CliRunner().invoke(main, command)
    assert "an emulated field is new" in again.output
    assert "by its Gaussians: " in again.output
    assert "nothing to do" in CliRunner().invoke(main, command).output
    assert (tmp_path / "run" / "surrogate" / "model.safetensors").read_bytes() == trained
    assert set(Surrogate.load(tmp_path / "run" / "surrogate").scores.psnr["view"]) == {GAUSSIANS, FIELD, BOTH}


@pytest.mark.slow
@pytest.mark.parametrize(("step", "drawn_by"), [(0, FIELD), (3, GAUSSIANS)])
def test_members_that_are_left_out_tell_what_draws_where_none_validate(
    tmp_path: Path, step: int, drawn_by: str
) -> None:
    """The field draws where it predicts them well, not where a blob moves by more than its size."""
    whole = [blob(size=4 * SIDE)[::2, ::2, ::2] ** 4 * (0.9 + 0.05 * i) for i in range(5)]
    fields = [np.roll(field, step * (i - 2), 2) for i, field in enumerate(whole)]
    catalog = catalog_of(tmp_path / "a.cdb", fields, splits=("train",) * 5)
    settings = replace(SETTINGS, deformation_steps=300, gaussians=200, initialization="in-situ")
    surrogate = train(settings, catalog, tmp_path / "run")
    assert surrogate.representations == (GAUSSIANS, FIELD, BOTH)
    assert surrogate.representation("view") == drawn_by
    assert surrogate.representation("isovalue") == drawn_by
    assert set(surrogate.scores.psnr.get("view", {})) == ({FIELD} if drawn_by == FIELD else set())
