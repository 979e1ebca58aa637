from __future__ import annotations

import torch

from surrogate.rasterizer import Rasterizer, primitives
from surrogate.splatting import Primitives, reference
from surrogate.training.compression import importance
from surrogate.training.data import Example
from tests.support.blobs import Blobs


def test_it_is_the_sum_of_transmittance_and_alpha() -> None:
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


def test_what_is_hidden_or_out_of_sight_has_none() -> None:
    blobs = Blobs()
    gaussians = blobs.gaussians(0.5)
    gaussians.means[0] = torch.tensor([50.0, 50.0, 50.0])
    gaussians.opacity_logits[1] = -20.0
    example = Example(blobs.cameras()[0], torch.tensor([0.5]), None)  # type: ignore[arg-type]
    found = importance(lambda _: gaussians, [example], Rasterizer())
    assert found[:2].tolist() == [0.0, 0.0]
    assert (found[2:] > 0).any()
