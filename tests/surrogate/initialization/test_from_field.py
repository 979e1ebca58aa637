"""Gaussians that start from the emulated field: in the medium, of its values, and near its pictures before any step."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from native.ray_casting import draw_volume
from surrogate.appearance.field_gaussians import FieldValues
from surrogate.appearance.scale import ValueScale
from surrogate.deformation import BilinearDeformation
from surrogate.emulation import FieldEmulator
from surrogate.gaussians import Normalization
from surrogate.initialization.from_field import EVEN, start_from_field
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings

SIZE = 24
SPACING, ORIGIN = (0.2, 0.1, 0.1), (5.0, -1.0, 2.0)
FUNCTION = TransferFunction(((0.0, 0.1, 0.3, 1.0), (1.0, 1.0, 0.4, 0.0)), ((0.1, 0.0), (1.0, 0.6)), 0.5)
POINTS = np.linspace(-1.0, 1.0, 5)[:, None]


def fields(holes: bool = False) -> np.ndarray:
    """A blob in the lower half that wanders along x, (5, 24, 24, 24)."""
    z, y, x = np.meshgrid(*[np.linspace(-1.0, 1.0, SIZE)] * 3, indexing="ij")
    members = [np.exp(-((x - 0.2 * p) ** 2 + y**2 + (z + 0.5) ** 2) / 0.18) for p in POINTS[:, 0]]
    stack = np.stack(members).astype(np.float32)
    if holes:
        stack[:, :, :, :8] = np.nan
    return stack


def started(holes: bool = False, count: int = 4000):  # type: ignore[no-untyped-def]
    emulator = FieldEmulator.fit(POINTS, fields(holes), SPACING, ORIGIN)
    field = FieldValues(FUNCTION, ValueScale.of_function(FUNCTION))
    high = np.array(ORIGIN) + np.array(SPACING) * (SIZE - 1)
    normalization = Normalization.of_box((ORIGIN, high))
    start = start_from_field(TrainingSettings(gaussians=count, latent_size=4), emulator, field, normalization)
    return emulator, start, normalization, high


def test_gaussians_start_where_members_are_opaque() -> None:
    _, start, normalization, high = started()
    places = start.gaussians.means.double().numpy() * normalization.extent + normalization.center
    assert ((places >= np.array(ORIGIN) - 1e-5) & (places <= high + 1e-5)).all()
    middle = (np.array(ORIGIN) + high) / 2.0
    lower = float((places[:, 2] < middle[2]).mean())
    assert lower > 1.0 - 0.6 * EVEN
    assert (places[:, 2] > middle[2]).any(), "some are everywhere"
    scales = start.gaussians.log_scales[:, 0].exp().numpy()
    assert np.median(scales[places[:, 2] < middle[2]]) < np.median(scales[places[:, 2] > middle[2]])


def test_none_starts_in_holes_of_all_members() -> None:
    _, start, normalization, _ = started(holes=True)
    places = start.gaussians.means.double().numpy() * normalization.extent + normalization.center
    assert places[:, 0].min() >= ORIGIN[0] + 7.5 * SPACING[0] - 1e-5
    assert torch.isfinite(start.emulated.modes).all()


def test_the_first_picture_is_near_the_field() -> None:
    emulator, start, normalization, high = started()
    deformation = BilinearDeformation.create(start.gaussians, 1, TrainingSettings(latent_size=4))
    moving = BilinearDeformation(**{**vars(deformation), "emulated": start.emulated})
    center = (np.array(ORIGIN) + high) / 2.0
    camera = Camera.look_at(
        center + np.array([3.0, -14.0, 4.0]), center, vertical_fov_degrees=30.0, width=64, height=64
    )
    for p in (-1.0, 0.1, 0.9):
        emulated = emulator.at([p])
        truth = draw_volume(emulated.values, None, SPACING, ORIGIN, VolumeRendering("v", FUNCTION), camera)
        shown = moving.deformed(start.gaussians, torch.tensor([p])).drawn()
        picture = Rasterizer().draw(shown, normalization.camera(camera))
        error = np.concatenate([picture.color.numpy(), picture.alpha.numpy()[..., None]], axis=-1) - truth
        assert -10.0 * np.log10(np.mean(error**2)) > 24.0


def test_values_on_the_carried_scale_are_taken_as_they_are() -> None:
    scale = ValueScale.of_function(FUNCTION)
    emulator, start, *_ = started()
    assert emulator.scale is None
    assert start.emulated.scale is not None
    np.testing.assert_array_equal(start.emulated.scale.knots, scale.knots)
    np.testing.assert_allclose(
        start.gaussians.values[:, 0].numpy(), scale.places(start.emulated.means.numpy()).clip(-0.2, 1.2), atol=1e-5
    )


@pytest.mark.parametrize("count", [1, 7])
def test_few_gaussians_start_too(count: int) -> None:
    _, start, *_ = started(count=count)
    assert all(torch.isfinite(t).all() for t in start.gaussians.tensors().values())
