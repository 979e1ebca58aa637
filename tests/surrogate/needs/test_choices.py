"""Each choice on a model whose needs are known, and a model that is never worse than the tolerance allows."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from surrogate.gaussians import NAMES
from surrogate.needs import NEEDS, Needs, choose_color_degree, fit_to_need
from surrogate.needs.attributes import choose_attributes
from surrogate.needs.fitted import Bench
from surrogate.needs.modes import choose_modes
from surrogate.needs.precision import choose_precision
from surrogate.needs.pruning import choose_gaussians
from tests.surrogate.needs.conftest import TRUE_MODES, MakeKnown, same


@pytest.mark.parametrize("moving", [("means",), ("colors",), ("opacity_logits", "log_scales"), ()])
def test_only_what_moves_is_kept_moving(make_known: MakeKnown, moving: tuple[str, ...]) -> None:
    known = make_known(moving)
    everything = replace(known.fitted.deformation, units=torch.full((14,), 1e-6) + known.fitted.deformation.units)  # type: ignore[attr-defined,type-var]
    fitted, choice = choose_attributes(known.fitted._replace(deformation=everything), known.bench)  # type: ignore[arg-type]
    assert {name for name in NAMES if fitted.deformation.moves(name)} == set(moving)
    assert choice.after is not None
    assert choice.before is not None
    assert choice.after.psnr >= choice.before.psnr - known.bench.tolerance
    assert choice.after.megabytes < choice.before.megabytes


def test_as_many_modes_stay_as_there_are(make_known: MakeKnown) -> None:
    known = make_known(("means", "colors"))
    fitted, choice = choose_modes(known.fitted, known.bench)
    assert fitted.deformation.latent_size == TRUE_MODES
    assert choice.kept == str(TRUE_MODES)
    assert known.bench.psnr(fitted) >= known.bench.psnr(known.fitted) - known.bench.tolerance


def test_gaussians_that_no_view_needs_go(make_known: MakeKnown) -> None:
    known = make_known(useless=30)
    assert len(known.fitted.gaussians) == 42
    fitted, choice = choose_gaussians(known.fitted, known.bench)
    assert len(fitted.gaussians) <= 12
    assert float(fitted.gaussians.opacity_logits.min()) > -8.0
    assert known.bench.psnr(fitted) >= known.bench.psnr(known.fitted) - known.bench.tolerance
    assert choice.kept == str(len(fitted.gaussians))


def test_precision_costs_no_more_than_the_tolerance_and_saves_most_bytes(make_known: MakeKnown) -> None:
    known = make_known(("means", "colors"))
    fitted, encodings, choice = choose_precision(known.fitted, known.bench)
    assert choice.before is not None
    assert choice.after is not None
    assert choice.after.psnr >= choice.before.psnr - known.bench.tolerance
    assert choice.after.megabytes < 0.6 * choice.before.megabytes
    stored = fitted.tensors()
    for name, encoding in encodings.items():
        assert torch.equal(stored[name], encoding.decoded())


def test_without_any_tolerance_precision_never_costs_anything(make_known: MakeKnown) -> None:
    known = make_known()
    strict = Bench(replace(known.bench.settings, need_tolerance=0.0), known.bench.data)
    _, _, choice = choose_precision(known.fitted, strict)
    assert choice.before is not None
    assert choice.after is not None
    assert choice.after.psnr >= choice.before.psnr


@pytest.mark.parametrize(("directional", "degree"), [(0.0, 0), (0.4, 1)])
def test_colours_depend_on_the_direction_only_where_they_do(
    make_known: MakeKnown, directional: float, degree: int
) -> None:
    known = make_known(directional=directional)
    before = known.fitted.copy()
    chosen, choice = choose_color_degree(known.fitted, known.bench)
    assert chosen == degree
    assert choice.kept == str(degree)
    assert [option.name for option in choice.options] == ["degree 0", "degree 1"]
    assert same(known.fitted.gaussians, before.gaussians)


def test_all_choices_in_turn_are_repeatable_and_change_nothing_in_place(make_known: MakeKnown) -> None:
    known = make_known(("means", "opacity_logits"), useless=10)
    before, found = known.fitted.copy(), []
    for _ in range(2):
        needs = Needs(known.fitted)
        while needs.done < len(NEEDS):
            needs, choice = fit_to_need(needs, known.bench)
        found.append(needs)
    assert same(known.fitted.gaussians, before.gaussians)
    assert same(found[0].fitted.gaussians, found[1].fitted.gaussians)
    pairs = zip(*(n.fitted.deformation.tensors().values() for n in found), strict=True)
    assert all(torch.equal(a, b) for a, b in pairs)
    lost = known.bench.psnr(known.fitted) - known.bench.psnr(found[0].fitted)
    assert lost <= (len(NEEDS) - 1) * known.bench.tolerance
    assert choice.name == "precision"


def test_a_choice_says_what_it_measured_in_plain_json(make_known: MakeKnown) -> None:
    known = make_known()
    _, choice = choose_modes(known.fitted, known.bench)
    record = choice.to_json()
    assert record["name"] == "modes of deformation"
    assert set(record["before"]) == {"psnr", "megabytes", "milliseconds"}
    assert all(set(option) == {"name", "psnr"} for option in record["options"])
