"""Each choice on a model whose needs are known, and a model that is never worse than the tolerance allows."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from types import SimpleNamespace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from surrogate.gaussians import NAMES
from surrogate.rasterizer import Rasterizer, primitives
from surrogate.splatting import Primitives, reference
from surrogate.storage.encoding import FORMATS, encode
from surrogate.training.compression.choices import (
    choices,
    choose_attributes,
    choose_gaussians,
    choose_modes,
    importance,
    least,
)
from surrogate.training.compression.color_degree import choose_color_degree
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.compression.precision import choose_precision
from surrogate.training.data import Example
from tests.support.blobs import Blobs
from tests.support.comparing import same
from tests.surrogate.training.compression.conftest import TRUE_MODES, MakeKnown


@pytest.mark.parametrize("moving", [("means",), ("colors",), ("opacity_logits", "log_scales"), ()])
def test_only_what_moves_is_kept_moving(make_known: MakeKnown, moving: tuple[str, ...]) -> None:
    known = make_known(moving)
    everything = replace(known.fitted.deformation, units=torch.full((14,), 1e-6) + known.fitted.deformation.units)  # type: ignore[attr-defined,type-var]
    fitted, choice = choose_attributes(known.fitted._replace(deformation=everything), known.evaluator)  # type: ignore[arg-type]
    assert {name for name in NAMES if fitted.deformation.moves(name)} == set(moving)
    assert choice.after is not None
    assert choice.before is not None
    assert choice.after.psnr >= choice.before.psnr - known.evaluator.tolerance
    assert choice.after.megabytes < choice.before.megabytes


def test_as_many_modes_stay_as_there_are(make_known: MakeKnown) -> None:
    known = make_known(("means", "colors"))
    fitted, choice = choose_modes(known.fitted, known.evaluator)
    assert fitted.deformation.latent_size == TRUE_MODES
    assert choice.kept == str(TRUE_MODES)
    assert known.evaluator.psnr(fitted) >= known.evaluator.psnr(known.fitted) - known.evaluator.tolerance


def test_gaussians_that_no_view_needs_go(make_known: MakeKnown) -> None:
    known = make_known(useless=30)
    assert len(known.fitted.gaussians) == 42
    fitted, choice = choose_gaussians(known.fitted, known.evaluator)
    assert len(fitted.gaussians) <= 12
    assert float(fitted.gaussians.opacity_logits.min()) > -8.0
    assert known.evaluator.psnr(fitted) >= known.evaluator.psnr(known.fitted) - known.evaluator.tolerance
    assert choice.kept == str(len(fitted.gaussians))


def test_precision_costs_no_more_than_the_tolerance_and_saves_most_bytes(make_known: MakeKnown) -> None:
    known = make_known(("means", "colors"))
    fitted, encodings, choice = choose_precision(known.fitted, known.evaluator)
    assert choice.before is not None
    assert choice.after is not None
    assert choice.after.psnr >= choice.before.psnr - known.evaluator.tolerance
    assert choice.after.megabytes < 0.6 * choice.before.megabytes
    stored = fitted.tensors()
    for name, encoding in encodings.items():
        assert torch.equal(stored[name], encoding.decoded())


def test_without_any_tolerance_precision_never_costs_anything(make_known: MakeKnown) -> None:
    known = make_known()
    strict = Evaluator(known.evaluator.settings.changed(need_tolerance=0.0), known.evaluator.data)
    _, _, choice = choose_precision(known.fitted, strict)
    assert choice.before is not None
    assert choice.after is not None
    assert choice.after.psnr >= choice.before.psnr


def test_what_half_precision_can_not_hold_stays_as_it_is(make_known: MakeKnown) -> None:
    """One that no view shows has gone far away: levels between it and the others are too coarse, and half precision ends before."""
    known = make_known(useless=1)
    lost = int(known.fitted.gaussians.opacity_logits.argmin())
    known.fitted.gaussians.means[lost] = 1e6
    strict = Evaluator(known.evaluator.settings.changed(need_tolerance=0.0), known.evaluator.data)
    fitted, encodings, _ = choose_precision(known.fitted, strict)
    assert "gaussians.means" not in encodings
    assert all(torch.isfinite(tensor).all() for tensor in fitted.tensors().values())


def test_no_format_takes_more_bytes_than_another_that_would_do(make_known: MakeKnown) -> None:
    """Levels come with two numbers per column: of a few rows they take more than half precision, of one more than float32."""
    known = make_known(("opacity_logits",))
    assert known.fitted.deformation.stored()["weights_out"].shape == (6, 8)
    anything = Evaluator(known.evaluator.settings.changed(need_tolerance=100.0), known.evaluator.data)
    _, encodings, choice = choose_precision(known.fitted, anything)
    stored = known.fitted.tensors()
    assert set(encodings) == set(stored)
    for name, encoding in encodings.items():
        assert encoding.saved_bytes == max(encode(stored[name], form).saved_bytes for form in FORMATS)
    assert encodings["deformation.weights_out"].form == "float16"
    assert choice.after is not None
    assert choice.after.megabytes < known.fitted.megabytes


def test_precision_is_judged_in_main_memory_however_training_draws(make_known: MakeKnown) -> None:
    known = make_known()
    on_a_gpu = Evaluator(known.evaluator.settings.changed(backend="cuda"), known.evaluator.data)
    _, encodings, _ = choose_precision(known.fitted, on_a_gpu)
    _, expected, _ = choose_precision(known.fitted, known.evaluator)
    assert {name: e.form for name, e in encodings.items()} == {name: e.form for name, e in expected.items()}


def test_milliseconds_end_when_the_picture_is_there(make_known: MakeKnown, monkeypatch: pytest.MonkeyPatch) -> None:
    """A GPU returns from drawing before it has drawn; fetching what it drew waits for it."""
    known = make_known()

    class Unfinished:
        def cpu(self) -> None:
            time.sleep(0.05)

    monkeypatch.setattr(Rasterizer, "draw", lambda *_: SimpleNamespace(color=Unfinished()))
    assert known.evaluator.measure(known.fitted, psnr=30.0).milliseconds >= 50.0


@pytest.mark.parametrize(("directional", "degree"), [(0.0, 0), (0.4, 1)])
def test_colours_depend_on_the_direction_only_where_they_do(
    make_known: MakeKnown, directional: float, degree: int
) -> None:
    known = make_known(directional=directional)
    before = known.fitted.copy()
    chosen, choice = choose_color_degree(known.fitted, known.evaluator)
    assert chosen == degree
    assert choice.kept == str(degree)
    assert [option.name for option in choice.options] == ["degree 0", "degree 1"]
    assert same(known.fitted.gaussians, before.gaussians)


@pytest.mark.slow
def test_all_choices_in_turn_are_repeatable_and_change_nothing_in_place(make_known: MakeKnown) -> None:
    known = make_known(("means", "opacity_logits"), useless=10)
    before, found = known.fitted.copy(), []
    for _ in range(2):
        fitted = known.fitted
        for choose in choices(varied=False):
            fitted, _ = choose(fitted, known.evaluator)
        found.append(choose_precision(fitted, known.evaluator)[0])
    assert same(known.fitted.gaussians, before.gaussians)
    assert same(found[0].gaussians, found[1].gaussians)
    pairs = zip(*(fitted.deformation.tensors().values() for fitted in found), strict=True)
    assert all(torch.equal(a, b) for a, b in pairs)
    lost = known.evaluator.psnr(known.fitted) - known.evaluator.psnr(found[0])
    assert lost <= 4 * known.evaluator.tolerance


def test_no_gaussian_is_removed_that_a_variation_might_show() -> None:
    assert choose_gaussians not in choices(varied=True)
    assert choices(varied=False) == (*choices(varied=True), choose_gaussians)


def test_a_choice_says_what_it_measured_in_plain_json(make_known: MakeKnown) -> None:
    known = make_known()
    _, choice = choose_modes(known.fitted, known.evaluator)
    record = asdict(choice)
    assert record["name"] == "modes of deformation"
    assert set(record["before"]) == {"psnr", "megabytes", "milliseconds"}
    assert all(set(option) == {"name", "psnr"} for option in record["options"])


@given(low=st.integers(-50, 50), size=st.integers(0, 200), place=st.integers(0, 200))
def test_the_least_that_will_do_is_found_in_few_questions(low: int, size: int, place: int) -> None:
    high, asked = low + size, []
    wanted = min(low + place, high)

    def will_do(value: int) -> bool:
        asked.append(value)
        return value >= wanted

    assert least(low, high, will_do) == wanted
    assert len(asked) <= size.bit_length()
    assert high not in asked


def test_importance_is_the_sum_of_transmittance_and_alpha() -> None:
    blobs, rasterizer = Blobs(), Rasterizer()
    gaussians, cameras = blobs.gaussians(0.3), blobs.cameras()[:3]
    examples = [Example(camera, torch.tensor([p]), None) for camera, p in zip(cameras, (0.0, 0.3, 0.9), strict=True)]  # type: ignore[arg-type]
    found = importance(lambda p: blobs.gaussians(float(p)), examples, rasterizer)
    expected = torch.zeros(len(gaussians), dtype=torch.float64)
    for example in examples:
        wide = blobs.gaussians(float(example.parameters))
        inputs = Primitives(*(t.double() for t in primitives(wide, example.camera)))
        splats = reference.project(inputs, example.camera, rasterizer.constants)
        pixels = reference.pixel_centers(example.camera).double()
        alphas = reference.alphas_at(pixels, splats, rasterizer.constants)
        matrix = torch.tensor(example.camera.world_to_camera)
        order = (inputs.means @ matrix[2, :3]).argsort()
        expected[order] += (reference.transmittances(alphas) * alphas).sum(0)
    torch.testing.assert_close(found.double(), expected, rtol=2e-4, atol=1e-3)


def test_what_is_hidden_or_out_of_sight_has_no_importance() -> None:
    blobs = Blobs()
    gaussians = blobs.gaussians(0.5)
    gaussians.means[0] = torch.tensor([50.0, 50.0, 50.0])
    gaussians.opacity_logits[1] = -20.0
    example = Example(blobs.cameras()[0], torch.tensor([0.5]), None)  # type: ignore[arg-type]
    found = importance(lambda _: gaussians, [example], Rasterizer())
    assert found[:2].tolist() == [0.0, 0.0]
    assert (found[2:] > 0).any()
