"""Compared methods are asked for test images once for all views of the same parameters."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from research.studies.comparison.predictor import MOST, FitPredictor, measure
from research.studies.comparison.task import ComparisonTask
from tests.support.blobs import Blobs

MEMBERS = (("train", 0.0), ("train", 1.0), ("validation", 0.25), ("test", 0.5), ("test", 0.75))


class Remembering:
    """Shows its parameter, and remembers what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[tuple[float, int]] = []

    def at(self, parameters: torch.Tensor):
        def render(camera) -> np.ndarray:
            self.asked.append((float(parameters[0]), camera.width))
            return np.full((camera.height, camera.width, 4), float(parameters[0]), dtype=np.float32)

        return render


@pytest.fixture
def task(make_catalog) -> ComparisonTask:
    return ComparisonTask.of(make_catalog(Blobs(count=2, size=16), members=MEMBERS))


def test_views_of_the_same_parameters_follow_each_other(task: ComparisonTask) -> None:
    fit = Remembering()
    cases = [
        case for pair in zip(*[task.cells["unseen parameters"][k::10] for k in range(10)], strict=True) for case in pair
    ]
    found = {case: draw(case)[0] for batch, draw in FitPredictor(fit, task).batches(cases[::-1]) for case in batch}
    assert set(found) == set(cases)
    assert [p for p, _ in fit.asked] == sorted((p for p, _ in fit.asked), reverse=True)
    for case, picture in found.items():
        assert picture[0, 0, 0] == 2.0 * case.member.parameters["p"] - 1.0
        assert picture.shape == (16, 16, 4)


def test_a_change_is_one_of_parameters_and_a_view_is_not(task: ComparisonTask) -> None:
    fit = Remembering()
    change, view = measure(FitPredictor(fit, task).at, task.cells["unseen parameters"])
    parameters = [p for p, _ in fit.asked]
    assert len(parameters) == 2 * MOST
    assert parameters[::2] == parameters[1::2]
    assert all(one != other for one, other in zip(parameters[1::2], parameters[2::2], strict=False))
    assert 0.0 < view.lowest <= view.median <= view.highest
    assert change.median > 0.0
