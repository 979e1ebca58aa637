"""Scores of images and their means, against the definitions written out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surrogate.evaluation.cases import Case, cases_of
from surrogate.evaluation.metrics import Score, TrueImage, score
from surrogate.evaluation.perceptual import Perceptual, PerceptualMetrics
from surrogate.evaluation.predictor import SurrogatePredictor
from surrogate.evaluation.scoring import Scored, compare, mean, score_cases, spread
from tests.support.varied_blobs import MEMBERS, varied, varied_catalog, varied_surrogate


class Counting(PerceptualMetrics):
    """Says which pictures it was shown."""

    def __init__(self) -> None:
        super().__init__({"flip": lambda truth, prediction: float(np.abs(truth - prediction).mean())}, {})


def scored(error: float, perceptual: Perceptual | None = None) -> Scored:
    nothing = Case(None, 0, "dvr")  # type: ignore[arg-type]
    return Scored(nothing, Score(-10 * math.log10(error), 0.5, math.nan, error, 0.25), perceptual)


def test_the_mean_error_is_taken_before_decibels_are() -> None:
    both = [scored(1e-2), scored(1e-4)]
    assert mean(both, "psnr") == pytest.approx(30.0)
    assert mean(both, "psnr_of_mean_error") == pytest.approx(-10 * math.log10((1e-2 + 1e-4) / 2))
    assert mean([scored(1e-8)], "psnr_of_mean_error") == pytest.approx(80.0)  # not cut as images are
    assert mean(both, "covered") == 0.25
    assert mean([], "psnr_of_mean_error") is None


def test_images_without_a_metric_do_not_count() -> None:
    found = [scored(0.1), scored(0.1, Perceptual(math.nan, None, 0.25)), scored(0.1, Perceptual(0.5, None, 0.75))]
    assert mean(found, "flip") == 0.5
    assert mean(found, "ms_ssim") == 0.5
    assert mean(found, "lpips") is None
    assert mean(found, "psnr_foreground") is None


@pytest.mark.parametrize("background", [None, (0.0, 0.5, 1.0)])
def test_a_comparison_is_what_its_parts_are(background: tuple[float, float, float] | None) -> None:
    random = np.random.default_rng(0)
    alpha = (random.random((16, 16, 1)) > 0.5) * np.ones((16, 16, 1)) if background is None else np.ones((16, 16, 1))
    truth = np.concatenate([random.random((16, 16, 3)) * alpha, alpha], axis=-1).astype(np.float32)
    picture = np.clip(truth + 0.1 * random.standard_normal(truth.shape), 0, 1).astype(np.float32)
    found = compare(Case(None, 0, "dvr"), TrueImage(truth, background), picture, Counting())  # type: ignore[arg-type]
    behind = np.array(background or (1.0, 1.0, 1.0))
    pair = [np.clip(image[..., :3] + (1 - image[..., 3:]) * behind, 0, 1) for image in (truth, picture)]
    assert found.score == score(truth, picture, background)
    assert found.score.squared_error == pytest.approx(np.mean((pair[0] - pair[1]) ** 2), rel=1e-5)
    assert found.perceptual is not None
    assert found.perceptual.flip == pytest.approx(np.abs(pair[0] - pair[1]).mean(), rel=1e-5)
    share = alpha.mean() if background is None else (np.abs(truth[..., :3] - behind) > 2 / 255).any(axis=-1).mean()
    assert found.score.covered == pytest.approx(share)


def test_scores_keep_the_order_and_a_few_are_looked_at(tmp_path) -> None:
    surrogate = varied_surrogate()
    catalog = varied_catalog(tmp_path / "a.cdb", surrogate)
    names = {name: varied(name) for name in ("iso=1", "dvr", "tf-test-0")}
    cases = cases_of(catalog.members, names, ("train", "test"), ("test", "train"))
    shown = [(m, a, v) for m in ("test-0", "train-0", "train-1") for a in names for v in (0, 1, 3, 4)]
    shown = [(m, a, v) for m, a, v in shown if a in MEMBERS[m][1]]
    assert [(c.member.name, c.appearance, c.view) for c in cases] == shown
    mixed = [cases[i] for i in np.random.default_rng(0).permutation(len(cases))]
    done, asked = list[tuple[int, int]](), list[dict]()
    [scores] = score_cases(
        SurrogatePredictor(lambda parameters: asked.append(parameters) or surrogate.at(parameters), None),
        catalog,
        mixed,
        perceptual=Counting(),
        looked_at={mixed[i] for i in spread(len(mixed), 5)},
        progress=lambda *counts: done.append(counts),
    )
    found = list(scores.values())
    assert list(scores) == [s.target for s in found] == mixed
    assert min(s.score.psnr for s in found) > 57.0  # nothing was mixed up: only 8 bits are between them
    assert sum(s.perceptual is not None for s in found) == 5
    assert done[-1] == (len(cases), len(cases))
    assert len(asked) == 7  # three members under three, three and one appearances
    [elsewhere] = score_cases(SurrogatePredictor(surrogate.at, None, lambda _: {"p": 0.9}), catalog, mixed[:1])
    wrong = surrogate.at(p=0.9).render(mixed[0].camera)
    truth = catalog.image(mixed[0].member, mixed[0].appearance, mixed[0].view)
    assert elsewhere[mixed[0]].score == score(truth, wrong, None)


def test_a_few_are_spread_evenly() -> None:
    assert spread(5, 9) == [0, 1, 2, 3, 4]
    assert spread(101, 5) == [0, 25, 50, 75, 100]
    assert spread(10, 0) == spread(0, 10) == []
    assert len(spread(972, 40)) == 40
