"""Images of steps: read when they are due, the same whatever memory holds."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from surrogate import Surrogate, TrainingSettings, train
from surrogate.training import data, step_images
from surrogate.training.data import Example
from surrogate.training.downsampling import Downsampling
from surrogate.training.step_images import StepImages, share_in_memory
from tests.support.blobs import Blobs

QUICK = TrainingSettings(
    gaussians=30, canonical_steps=10, deformation_steps=20, color_degree=0, fit_to_need=False, batch=2
)


def example(number: int, width: int = 8, height: int = 6) -> Example:
    """A picture that shows its number in blue."""
    camera = Camera.look_at((0.4, -3.0, 0.7), (0, 0, 0), vertical_fov_degrees=40.0, width=width, height=height)
    pixels = np.zeros((height, width, 4), np.uint8)
    pixels[..., 2], pixels[..., 3] = number, 255
    return Example(camera, torch.zeros(1), pixels, f"member-{number}")


def test_images_are_read_once_each_ahead_of_their_step_by_another_thread() -> None:
    read: list[tuple[int, int]] = []

    def stored(number: int) -> Example:
        whole = example(number)

        def image() -> np.ndarray:
            read.append((number, threading.get_ident()))
            return whole.pixels

        return Example(whole.camera, whole.parameters, image, whole.member)

    examples = [stored(number) for number in range(12)]
    images = StepImages(examples, seed=0, batch=2, share=range(2))
    in_memory = StepImages([e.read() for e in examples], seed=0, batch=2, share=range(2))
    read.clear()
    for step in range(12):
        for place in range(2):
            learnt, same = images.next(step, place), in_memory.next(step, place)
            np.testing.assert_array_equal(learnt.pixels, same.pixels)
            assert learnt.member == same.member
            assert learnt.in_memory
    numbers = [number for number, _ in read[:24]]
    assert sorted(numbers) == sorted([*range(12), *range(12)])
    assert threading.get_ident() not in {thread for _, thread in read}
    assert len(read) <= 24 + 2 * step_images.AHEAD


@pytest.mark.parametrize(("memory", "kept"), [(1 << 20, 6), (3 * 4 * 3 * 4, 3), (0, 0)])
@pytest.mark.parametrize("in_memory", [True, False])
def test_early_images_are_downsampled_and_some_of_them_kept(
    monkeypatch: pytest.MonkeyPatch, memory: int, kept: int, in_memory: bool
) -> None:
    monkeypatch.setattr(step_images, "MEMORY", memory)
    read: list[int] = []

    def stored(number: int) -> Example:
        whole = example(number)

        def image() -> np.ndarray:
            read.append(number)
            return whole.pixels

        return whole if in_memory else Example(whole.camera, whole.parameters, image, whole.member)

    examples = [stored(number) for number in range(6)]
    images = StepImages(examples, 0, 1, range(1), Downsampling(2, 17))
    for step in range(24):
        learnt, whole = images.next(step, 0), images.at(step, 0)
        number = int(whole.member.removeprefix("member-"))
        side = 4 if step < 12 else 8
        assert (learnt.member, learnt.camera.width, learnt.pixels.shape[1]) == (whole.member, side, side)
        assert (learnt.pixels[..., 2] == number).all()
    if not in_memory:
        early, late = 6 + (6 - kept), 12
        assert early + late <= len(read) <= early + late + step_images.AHEAD
    assert share_in_memory(6 * 4 * 3 * 4) == pytest.approx(min(1.0, memory / (6 * 4 * 3 * 4)))


def test_an_image_that_can_not_be_read_says_so_at_its_step() -> None:
    def broken() -> np.ndarray:
        raise OSError("no such image")

    images = StepImages([Example(example(0).camera, torch.zeros(1), broken)], seed=0, batch=1, share=range(1))
    with pytest.raises(OSError, match="no such image"):
        images.next(0, 0)


@pytest.mark.parametrize("factor", [1, 2])
def test_a_model_is_bit_for_bit_the_same_where_memory_holds_no_image(
    make_catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, factor: int
) -> None:
    catalog, models = make_catalog(Blobs(count=4, size=16), view_splits=("train",) * 3), []
    for name, memory in (("all", 1 << 30), ("some", 4 * 16 * 16 * 4), ("none", 0)):
        monkeypatch.setattr(data, "MEMORY", memory)
        monkeypatch.setattr(step_images, "MEMORY", memory)
        train(QUICK.changed(early_downsampling=factor), catalog, tmp_path / name)
        models.append(Surrogate.load(tmp_path / name).at(p=0.4).gaussians.tensors())
    for other in models[1:]:
        for name, tensor in models[0].items():
            assert torch.equal(tensor, other[name]), name
