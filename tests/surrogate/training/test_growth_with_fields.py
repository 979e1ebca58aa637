"""A training that goes on follows the emulator of all members, where they keep coarse fields; variations go on as well."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from click.testing import CliRunner

import insitu
from catalogs.store.catalog import Catalog
from surrogate.appearance.field_gaussians import FieldGaussians
from surrogate.cli import main
from surrogate.deformation import BilinearDeformation
from surrogate.model import FieldModel, Surrogate
from surrogate.model.representation import FIELD
from surrogate.storage.runs import RunFolder
from surrogate.training import source as source_module
from surrogate.training.emulator import fit
from surrogate.training.growth import warm_start
from surrogate.training.source import Source
from tests.support.field_catalogs import SIZE, field, rendered

pytestmark = pytest.mark.slow

WORDS = ("gaussians=60", "canonical_steps=4", "deformation_steps=8", "visualization_steps=6", "fit_to_need=false")


def command(*words: object) -> str:
    result = CliRunner().invoke(main, ["train", *map(str, words)])
    assert result.exit_code == 0, result.output
    return result.output


def add_members(catalog: Path) -> None:
    """Two members more, drawn as the others are."""
    with insitu.Session(catalog) as session:
        for p in (0.4, 0.9):
            session.render_member(field(p), {"p": p}, spacing=(1.1 / (SIZE - 1),) * 3)


def points_of(surrogate: Surrogate) -> int:
    """Members that the emulated values of its Gaussians know."""
    assert surrogate.deformation.emulated is not None
    return len(surrogate.deformation.emulated.processes.points)


def test_gaussians_and_the_field_know_all_members_then(tmp_path: Path) -> None:
    catalog, run = rendered(tmp_path / "a.cdb", surface=False), tmp_path / "run"
    command(catalog.path, "-o", run, *WORDS)
    assert points_of(Surrogate.load(run / "surrogate")) == 5
    add_members(catalog.path)
    assert "2 later members, 4 steps" in command(run, "--new-members")
    surrogate = Surrogate.load(run / "surrogate")
    assert surrogate.field is not None
    [emulator] = surrogate.field.emulators.values()
    assert points_of(surrogate) == 7
    assert len(emulator.processes.points) == 8  # the member for validation as well, once all is chosen


def test_values_stay_on_average_where_the_emulator_is_another(tmp_path: Path) -> None:
    catalog, run = rendered(tmp_path / "a.cdb", surface=False), tmp_path / "run"
    command(catalog.path, "-o", run, *WORDS)
    old = Surrogate.load(run / "surrogate")
    add_members(catalog.path)
    source = Source(RunFolder.open(run).settings, Catalog.open(catalog.path))
    state = warm_start(old, source, fit(source, ""))
    assert isinstance(state.fitted.gaussians, FieldGaussians)
    before, after = [], []
    for member in RunFolder.open(run).catalog.members:
        if member.split == "train":
            place = torch.tensor(source.space.normalize([member.parameters["p"]])).float().reshape(-1)
            before.append(old.deformation.deformed(old.gaussians, place).values[:, 0])  # type: ignore[union-attr]
            after.append(state.fitted.deformation.deformed(state.fitted.gaussians, place).values[:, 0])  # type: ignore[union-attr]
    torch.testing.assert_close(torch.stack(after).mean(0), torch.stack(before).mean(0), atol=1e-5, rtol=0)
    assert (torch.stack(after) - torch.stack(before)).abs().max() < 0.1


def test_a_run_of_the_field_alone_takes_members_in(tmp_path: Path) -> None:
    catalog, run = rendered(tmp_path / "a.cdb", surface=False), tmp_path / "run"
    command(catalog.path, "-o", run, *WORDS, "--model", "field")
    add_members(catalog.path)
    assert "takes 2 later members in" in command(run, "--model", "field", "--new-members")
    surrogate = Surrogate.load(run / "surrogate")
    assert surrogate.representations == (FIELD,)
    assert len(FieldModel.load(run / "surrogate").emulators[""].processes.points) == 8
    command(run)  # all steps, as there are no Gaussians yet
    assert Surrogate.load(run / "surrogate").training["steps"] == 12


def test_surfaces_go_on_from_their_own_gaussians(tmp_path: Path) -> None:
    catalog, run = rendered(tmp_path / "a.cdb"), tmp_path / "run"
    command(catalog.path, "-o", run, *WORDS)
    [before] = Surrogate.load(run / "surrogate").visualizations
    add_members(catalog.path)
    assert "2 later members, 6 steps" in command(run, "--new-members")
    [after] = Surrogate.load(run / "surrogate").visualizations
    assert before.gaussians is not None
    assert after.gaussians is not None
    assert isinstance(after.deformation, BilinearDeformation)
    assert (after.gaussians.means - before.gaussians.means).abs().max() < 0.1  # anew they would start elsewhere


def test_gaussians_that_do_not_follow_a_field_that_predicts_well_by_now_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    catalog, run = rendered(tmp_path / "a.cdb", surface=False), tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(source_module, "MOST_ERROR", 0.0)
        command(catalog.path, "-o", run, *WORDS)
    add_members(catalog.path)
    said = "its Gaussians do not follow the emulated field, which predicts well by now: `surrogate train"
    assert said in command(run, "--new-members")
    assert Surrogate.load(run / "surrogate").deformation.emulated is None
