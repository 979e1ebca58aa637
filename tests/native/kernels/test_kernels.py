"""The compiled module by itself: what it refuses, and that threads, processes and reused memory leave no trace."""

from __future__ import annotations

import gc
import multiprocessing
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from native import kernels
from surrogate.splatting import Constants

Arrays = list[NDArray[np.float32]]
CONSTANTS = {
    "near": 0.05,
    "dilation": 0.1,
    "alpha_floor": 1 / 255,
    "alpha_cap": 0.999,
    "min_transmittance": 1e-4,
    "frame_margin": 0.15,
    "shortest_quaternion": 1e-12,
}


def gaussians(count: int, seed: int = 0) -> Arrays:
    random = np.random.default_rng(seed)
    values = (
        random.uniform(-0.6, 0.6, (count, 3)),
        random.uniform(0.02, 0.2, (count, 3)),
        random.normal(size=(count, 4)),
        random.uniform(0.02, 0.9, count),
        random.uniform(0.0, 1.0, (count, 3)),
    )
    return [value.astype(np.float32) for value in values]


def draw(arrays: Arrays, width: int = 70, height: int = 50, threads: int = 1, **changes: Any) -> Any:
    camera = Camera.look_at((3, 0.6, 0.4), (0, 0, 0), vertical_fov_degrees=35.0, width=width, height=height)
    intrinsics = {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy}
    size = {"width": width, "height": height}
    chosen = [[changes.pop(name, values[name]) for name in values] for values in (intrinsics, size, CONSTANTS)]
    return kernels.forward(arrays, camera.world_to_camera, *chosen, threads, **changes)


def everything(arrays: Arrays, width: int = 70, height: int = 50, threads: int = 1) -> list[NDArray[np.float32]]:
    """The picture and all gradients of its sum."""
    drawing = draw(arrays, width, height, threads)
    return [drawing.picture, *kernels.backward(drawing, np.ones((height, width, 4), np.float32), threads)]


def same(first: list[NDArray[np.float32]], second: list[NDArray[np.float32]]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


def test_every_machine_has_the_baseline_and_the_best_comes_first() -> None:
    names = kernels.instruction_sets()
    assert names[-1] == "baseline"
    assert len(set(names)) == len(names)
    default, best = draw(gaussians(50)), draw(gaussians(50), instruction_set=names[0])
    assert np.array_equal(default.picture, best.picture)


def test_a_picture_of_any_number_and_size_does_not_depend_on_what_was_drawn_before() -> None:
    cases = [(300, 70, 50), (3, 200, 10), (0, 5, 5), (900, 33, 97), (1, 1, 1)]
    expected = [everything(gaussians(count, seed=count), width, height) for count, width, height in cases]
    for order in (range(5), reversed(range(5))):
        for k in order:
            count, width, height = cases[k]
            assert same(everything(gaussians(count, seed=count), width, height, threads=2), expected[k])


def test_calls_from_several_python_threads_at_once_do_not_disturb_each_other() -> None:
    scenes = [gaussians(2000, seed=k) for k in range(8)]
    expected = [everything(scene) for scene in scenes]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(3):
            found = list(pool.map(lambda scene: everything(scene, threads=3), scenes))
            assert all(same(a, b) for a, b in zip(found, expected, strict=True))


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_child_has_threads_of_its_own() -> None:
    scene = gaussians(300)
    expected = everything(scene, threads=2)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert same(pool.apply_async(everything, (scene, 70, 50, 2)).get(timeout=60), expected)


def test_a_drawing_keeps_what_it_needs_alive_and_can_be_differentiated_twice() -> None:
    expected = everything(gaussians(200))
    drawing = draw(gaussians(200))
    gc.collect()
    everything(gaussians(500, seed=3))  # takes memory that a careless drawing would still be reading
    for _ in range(2):
        assert same(list(kernels.backward(drawing, np.ones((50, 70, 4), np.float32), 1)), expected[1:])


def test_what_does_not_reach_the_picture_has_no_gradient() -> None:
    scene = gaussians(50)
    scene[0][:25, 1] = 100.0
    drawing = draw(scene)
    assert drawing.drawn <= 25
    assert not any(gradient[:25].any() for gradient in everything(scene)[1:])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("near", 3.0),
        ("dilation", 1.0),
        ("alpha_floor", 0.1),
        ("alpha_cap", 0.5),
        ("min_transmittance", 0.5),
        ("frame_margin", -0.4),
        ("shortest_quaternion", 1.0),
    ],
)
def test_every_constant_counts(name: str, value: float) -> None:
    assert list(CONSTANTS) == [*Constants.__annotations__]
    usual, changed = draw(gaussians(200)), draw(gaussians(200), **{name: value})
    assert not np.array_equal(usual.picture[..., 3], changed.picture[..., 3])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx": -1.0}, "focal lengths"),
        ({"cx": float("nan")}, "finite"),
        ({"near": 0.0}, "near must be positive"),
        ({"dilation": -0.1}, "dilation must not be negative"),
        ({"alpha_floor": 0.0}, "alpha_floor must lie between 0 and 1"),
        ({"instruction_set": "abacus"}, "none of this machine's: .*baseline"),
    ],
    ids=lambda value: str(value),
)
def test_bad_constants_are_refused_by_name(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        draw(gaussians(5), **change)


@pytest.mark.parametrize("size", [(0, 50), (70, 0), (-1, 50), (70, -1)])
def test_pictures_without_pixels_are_refused(size: tuple[int, int]) -> None:
    """By the kernels themselves: there is no camera of such a size to ask them with."""
    intrinsics = [100.0, 100.0, 35.0, 25.0]
    with pytest.raises(ValueError, match="image size and focal lengths must be positive"):
        kernels.forward(gaussians(5), np.eye(4), intrinsics, list(size), [*CONSTANTS.values()], 1)


def test_bad_arrays_are_refused() -> None:
    scene = gaussians(5)
    with pytest.raises(ValueError, match=r"quats must have shape \[5, 4\], got \[5, 3\]"):
        draw([*scene[:2], scene[0], *scene[3:]])
    drawing = draw(scene)
    with pytest.raises(ValueError, match=r"gradient must have shape \[50, 70, 4\]"):
        kernels.backward(drawing, np.zeros((50, 71, 4), np.float32), 1)


def test_a_background_shows_through_what_is_not_opaque() -> None:
    scene, color = gaussians(20), np.array([0.2, 0.5, 1.0], np.float32)
    plain, over = draw(scene).picture, draw(scene, background=tuple(color.tolist())).picture
    assert np.array_equal(over[..., 3], plain[..., 3])
    np.testing.assert_allclose(over[..., :3], plain[..., :3] + (1 - plain[..., 3:]) * color, rtol=1e-5, atol=1e-6)


def test_other_layouts_and_precisions_are_converted() -> None:
    scene = gaussians(30)
    other = [np.asfortranarray(scene[0]), scene[1].astype(np.float64), *scene[2:]]
    assert same(everything(other), everything(scene))
    with pytest.raises(TypeError):
        draw([[1.0, 2.0, 3.0], *scene[1:]])  # type: ignore[list-item]
