"""The first paragraph of a report, by rules over its record."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.report.members import shares, squares
from surrogate.report.outlook import longer_training
from surrogate.report.verdict import verdict

RE_TIME = (Parameter("Re", 0.0, 1000.0), Parameter("time", 0.0, 10.0))
GOOD = {"structures": 0.99, "colours": 0.98, "details": 0.9}
CURVE = [{"stage": "deformation", "step": 1000 * i, "psnr": 30.0 + i} for i in range(1, 11)]


def member(split: str, number: int, psnr: float | None = 35.0, predicted: Any = None) -> dict[str, Any]:
    at = {"Re": 100.0 * (number % 3), "time": float(number)}
    return {
        "name": f"{split}-{number}",
        "split": split,
        "parameters": at,
        "psnr_foreground": psnr,
        "predicted": predicted,
    }


def cell(value: Any) -> dict[str, Any]:
    both = {"seen_parameters": value, "unseen_parameters": value}
    return {"seen_views": both, "unseen_views": both}


def predictor(name: str, psnr: float, representation: str = "") -> dict[str, Any]:
    own = {"psnr_foreground": psnr, "psnr": psnr + 4.0}
    return {"name": name, "representation": representation, "validation": own, **{m: cell(v) for m, v in own.items()}}


def record(**changes: Any) -> dict[str, Any]:
    """The record of a good surrogate with ten test members, changed."""
    tests = changes.pop("tests", [member("test", i, 40.0 - i, GOOD) for i in range(10)])
    others = changes.pop("others", [member("train", i) for i in range(20)] + [member("validation", 1)])
    own = {
        **predictor("", 35.0),
        "parameters": ParameterSpace(RE_TIME).to_json(),
        "members": [*tests, *others],
        "images": cell(40 if tests else 0),
        "empty": {"images": 0, "of": 160},
        "one_in_ten": {
            "psnr_foreground": cell(31.0),
            "psnr": cell(34.5),
            "validation": {"psnr_foreground": 33.0, "psnr": 36.0},
        },
        "trivial_predictors": [
            predictor("mean image", 20.0),
            predictor("ridge regression (degree 3)", 28.0),
            predictor("the emulated field, drawn (4 MB)", 33.0, "field"),
        ],
        "curve": CURVE,
        "gaussians": 100,
        "outlook": {"importance": {"Re": 0.1, "time": 0.2}, "gains": [], "lacks": ""},
    }
    return {**own, **changes}


def test_a_good_surrogate_is_believed_wherever_it_was_tested() -> None:
    first, second = verdict(record()).split("\n\n")
    assert first == (
        "**Believe** place and size of structures, colours, and fine detail wherever it was tested.  "
        "One picture in ten of 10 test members that training never saw is below 31.0 dB "
        "where it shows something (34.5 dB as a whole); the worst fourth of the members is at time > 6.5.  "
        "On average pictures are 7.0 dB closer to the truth than the best simple prediction (ridge regression).  "
        "Drawn from the emulated field alone, pictures are 2.0 dB worse."
    )
    assert second.startswith("Longer training would help the Gaussians: ")


def aspects(**changes: Any) -> list[dict[str, Any]]:
    """Test members of which some predict an aspect badly."""
    return [
        member("test", i, 35.0, {**GOOD, **{a: 0.2 for a, places in changes.items() if i in places}}) for i in range(10)
    ]


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        ({"details": range(10)}, "**Do not believe** fine detail anywhere."),
        ({"details": (7, 8, 9)}, "**Do not believe** fine detail at time > 6.5."),
        ({"details": (7, 8, 9)}, "; fine detail at time < 6.5."),
        ({"colours": (7, 8, 9), "details": (7, 8, 9)}, "**Do not believe** colours, and fine detail at time > 6.5."),
        ({"colours": (2,)}, "; colours except at 1 of 10 members (test-2).  There test-2 has time = 2, Re = 200."),
        ({"colours": (1, 3, 5, 6)}, "; colours except at 4 of 10 members, in no range of parameters"),
        ({"colours": (1, 3, 5, 6, 8)}, "**Do not believe** colours at 5 of 10 members, in no range of parameters."),
    ],
)
def test_words_follow_what_is_predicted_and_where(bad: dict[str, Any], said: str) -> None:
    assert said in verdict(record(tests=aspects(**bad)))


FEW = [member("test", i, 35.0, GOOD) for i in range(2)]


@pytest.mark.parametrize(
    ("changes", "begins"),
    [
        ({"empty": {"images": 160, "of": 160}}, "**All 160 pictures are blank: nothing was learnt or tested.**"),
        ({"empty": {"images": 60, "of": 160}}, "**60 of 160 pictures are blank**"),
        ({"tests": FEW}, "**Only 2 members tested this: too few for the box of parameters.**"),
        ({"others": [member("train", i) for i in range(2)]}, "**2 members to learn from: between so few"),
        (
            {"trivial_predictors": [predictor("mean image", 36.5)]},
            "**Do not use these pictures: the mean of the training pictures is 1.5 dB closer to the truth.**",
        ),
        ({"tests": [], "others": [member("train", 1)] * 5}, "**No member was kept aside"),
        ({"tests": []}, "**Only 1 member tested this"),
        ({"parameters": [], "tests": FEW}, "**Believe** place"),
        ({"parameters": ParameterSpace(RE_TIME[1:]).to_json()}, "**Believe** place"),
        ({"trivial_predictors": []}, "**Believe** place"),
    ],
)
def test_what_would_mislead_comes_first(changes: dict[str, Any], begins: str) -> None:
    assert verdict(record(**changes)).startswith(begins)


def test_a_better_simple_prediction_is_named() -> None:
    said = verdict(record(trivial_predictors=[predictor("mean image", 20.0), predictor("linear interpolation", 36.0)]))
    assert said.startswith("**Believe**")
    assert "**At stored views a simple prediction (linear interpolation) is 1.0 dB closer to the truth.**" in said


def test_nothing_else_is_said_of_blank_pictures() -> None:
    said = verdict(record(empty={"images": 160, "of": 160}))
    assert "elieve" not in said
    assert "Longer" not in said


def test_validation_members_judge_where_no_others_do_and_that_is_said() -> None:
    said = verdict(
        record(tests=[], others=[member("validation", i) for i in range(5)] + [member("train", i) for i in range(9)])
    )
    assert "One picture in ten of 5 validation members, by which the model was chosen, too, is below 33.0 dB" in said
    assert "7.0 dB closer to the truth than the best simple prediction (ridge regression)" in said


def test_gains_and_what_the_model_lacks_are_said() -> None:
    gains = [{"more": 10, "decibels": 1.2, "low": 0.1, "high": 2.3}]
    outlook = {"importance": {}, "gains": gains, "lacks": "This model holds no emulated fields."}
    said = verdict(record(outlook=outlook))
    assert "10 more members, about +1.2 dB (+0.1 to +2.3)" in said
    assert said.endswith("This model holds no emulated fields.")


def curve(*psnr: float | None, stage: str = "deformation") -> list[dict[str, Any]]:
    return [{"stage": stage, "step": 1000 * (i + 1), "psnr": value} for i, value in enumerate(psnr)]


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (CURVE, "would help the Gaussians: steps 3,500 to 7,000 gave +3.5 dB"),
        (curve(*[30.0] * 10), "would hardly help the Gaussians: steps 3,500 to 7,000 gave +0.0 dB"),
        (curve(30.0, 32.0, 35.0, 33.0), "would not help: validation pictures were 2.0 dB better at step 3,000"),
        (curve(None, None, None, None), "not known"),
        ([], "not known"),
        (CURVE + curve(*[20.0] * 9, stage="isovalue"), "would help the Gaussians: steps 3,500 to 7,000"),
    ],
)
def test_longer_training_by_the_curve(points: list[dict[str, Any]], said: str) -> None:
    assert said in longer_training(points)


def test_squares_by_aspects_add_up_and_tell_them_apart() -> None:
    random = np.random.default_rng(0)
    any_picture = random.normal(size=(64, 96, 3)).astype(np.float32)
    assert squares(any_picture).sum() == pytest.approx((any_picture.astype(float) ** 2).sum())
    grey, red, stripes = np.full((64, 64, 3), 0.5), np.zeros((64, 64, 3)), np.zeros((64, 64, 3))
    red[..., 0], red[..., 1] = 0.5, -0.5
    stripes[::2], stripes[1::2] = 0.5, -0.5
    for number, picture in enumerate((grey, red, stripes)):
        parts = squares(picture.astype(np.float32))
        assert np.flatnonzero(parts > 1e-9).tolist() == [number]
    assert np.isfinite(squares(random.normal(size=(5, 3, 3)).astype(np.float32))).all()


@pytest.mark.parametrize(
    ("ours", "rival", "area", "wanted"),
    [
        (1.0, 10.0, 10, 0.9),
        (20.0, 10.0, 10, -1.0),
        (1e-6, 1e-7, 10, 1.0),  # rounding
        (0.0, 0.0, 10, 1.0),
        (1.0, 10.0, 0, None),  # a blank picture
    ],
)
def test_shares_are_of_what_the_mean_image_misses(ours: float, rival: float, area: int, wanted: float | None) -> None:
    found = shares(np.full(3, ours), np.full(3, rival), area)
    assert found == ([None] * 3 if wanted is None else pytest.approx([wanted] * 3))
