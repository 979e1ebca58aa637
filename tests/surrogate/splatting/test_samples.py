"""Pixels as means of several samples."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from surrogate.splatting.samples import averaged, finer

CAMERA = Camera.look_at((3.0, 1.0, 2.0), (0.1, 0.0, 0.2), vertical_fov_degrees=40.0, width=7, height=4)


@pytest.mark.parametrize("samples", [1, 2, 3, 4])
@pytest.mark.parametrize("channels", [(), (1,), (4,)], ids=str)
def test_a_pixel_is_the_mean_of_its_samples(samples: int, channels: tuple[int, ...]) -> None:
    random = torch.Generator().manual_seed(samples)
    picture = torch.rand(4 * samples, 7 * samples, *channels, dtype=torch.float64, generator=random).requires_grad_()
    expected = picture.reshape(4, samples, 7, samples, *channels).mean((1, 3))
    assert torch.allclose(averaged(picture, samples), expected, rtol=0.0, atol=1e-15)
    weights = torch.rand(4, 7, *channels, dtype=torch.float64, generator=random)
    [gradient] = torch.autograd.grad((weights * averaged(picture, samples)).sum(), picture)
    [wanted] = torch.autograd.grad((weights * expected).sum(), picture)
    assert torch.allclose(gradient, wanted, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_samples_lie_evenly_in_their_pixel(samples: int) -> None:
    """The means of their rays' places on the image plane are the pixels' centres."""

    def places(camera: Camera) -> np.ndarray:
        local = camera.rays()[1] @ camera.rotation.T
        return local[..., :2] / local[..., 2:]

    fine = torch.from_numpy(places(finer(CAMERA, samples)))
    assert fine.shape == (4 * samples, 7 * samples, 2)
    assert averaged(fine, samples).numpy() == pytest.approx(places(CAMERA), abs=1e-12)
