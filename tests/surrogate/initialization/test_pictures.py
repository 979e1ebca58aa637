from pathlib import Path

import numpy as np
import pytest

from catalogs.files.images import premultiply
from surrogate.initialization.pictures import foreground, representative_member, straight_colors
from tests.support.balls import Ball, grey, store
from tests.support.varied_blobs import varied_catalog, varied_surrogate

BALL = Ball(size=8)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([("train", 0.0), ("train", 0.4), ("train", 1.0), ("test", 0.47)], "member-1"),
        ([("train", 0.3), ("train", 0.6)], "member-0"),  # equally near: the first by name
        ([("validation", 0.5), ("train", 0.9)], "member-1"),
    ],
)
def test_the_representative_is_the_training_member_nearest_to_the_mean(
    tmp_path: Path, values: list[tuple[str, float]], expected: str
) -> None:
    catalog = store(tmp_path, BALL, grey, cameras=BALL.cameras()[:1], members=values)
    assert representative_member(catalog, "drawn").name == expected


def test_without_training_members_there_is_no_representative(tmp_path: Path) -> None:
    catalog = store(tmp_path, BALL, grey, cameras=BALL.cameras()[:1], members=[("test", 0.5)])
    with pytest.raises(ValueError, match="holds no training member that shows drawn"):
        representative_member(catalog, "drawn")


def test_the_representative_shows_the_appearance_that_is_learnt(tmp_path: Path) -> None:
    members = {"train-0": (0.0, ("dvr", "iso=2")), "train-1": (0.5, ("dvr",)), "train-2": (1.0, ("dvr",))}
    catalog = varied_catalog(tmp_path / "a.cdb", varied_surrogate(), members)
    assert representative_member(catalog, "dvr").name == "train-1"
    assert representative_member(catalog, "iso=2").name == "train-0"
    with pytest.raises(ValueError, match=r"holds no training member that shows iso=8"):
        representative_member(catalog, "iso=8")


def test_the_last_bits_of_alpha_are_no_foreground() -> None:
    straight = np.full((1, 256, 4), 200, np.uint8)
    straight[0, :, 3] = np.arange(256)
    shown = foreground(premultiply(straight), None)
    assert not shown[0, :3].any()
    np.testing.assert_array_equal(shown[0, 3:], premultiply(straight)[0, 3:])


def test_what_differs_from_the_background_counts_in_full() -> None:
    pixels = np.array([[[255, 128, 0, 255], [253, 127, 2, 255], [255, 128, 9, 255]]], np.uint8)
    shown = foreground(pixels, (1.0, 128 / 255, 0.0))
    np.testing.assert_array_equal(shown, [[[0, 0, 0, 0], [0, 0, 0, 0], [255, 128, 9, 255]]])


def test_colours_are_weighted_by_alpha_and_never_missing() -> None:
    sums = np.array([[0.2, 0.0, 0.4, 0.8], [0.0, 0.0, 0.0, 0.0]])
    np.testing.assert_allclose(straight_colors(sums), [[0.25, 0.0, 0.5], [0.25, 0.0, 0.5]])
    np.testing.assert_allclose(straight_colors(np.zeros((1, 4))), [[0.5, 0.5, 0.5]])
