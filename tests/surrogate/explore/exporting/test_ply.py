from __future__ import annotations

import io
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from surrogate.explore.exporting.ply import ply_bytes
from surrogate.explore.exporting.splats import SH_C0, SH_C2, Splats
from surrogate.gaussians import Normalization
from surrogate.lighting import Lighting
from surrogate.model import DeformedGaussians
from surrogate.splatting import render
from surrogate.splatting.directional import SH_C1
from tests.support.surrogates import some_surrogate

plyfile = pytest.importorskip("plyfile")

CENTER, EXTENT = np.array([10.0, -20.0, 5.0]), 7.0
CAMERA = Camera.look_at(CENTER + np.array([18.0, 20.0, 9.0]), CENTER, vertical_fov_degrees=35, width=40, height=32)
AT = {"Re": 1830.0, "time": 0.4}


def deformed(color_columns: int) -> DeformedGaussians:
    made = replace(some_surrogate(color_columns), normalization=Normalization(CENTER, EXTENT))
    return made.at(**AT)


def read(content: bytes) -> Any:
    return plyfile.PlyData.read(io.BytesIO(content))


def stacked(vertices: Any, prefix: str) -> NDArray[np.float64]:
    """All properties `prefix`0, `prefix`1, ... side by side, (N, .)."""
    names = sorted(
        (p.name for p in vertices.properties if p.name.startswith(prefix)), key=lambda n: int(n[len(prefix) :])
    )
    columns = [np.asarray(vertices[name], np.float64) for name in names]
    return np.stack(columns, axis=1) if columns else np.zeros((vertices.count, 0))


def decoded(content: bytes, position: NDArray[np.float64]) -> tuple[torch.Tensor, ...]:
    """The image of `surrogate.splatting.render`, by the formulas of the reference's `load_ply`, `forward.cu` and `sh_utils`."""
    vertices = read(content)["vertex"]
    means = np.stack([vertices[axis] for axis in "xyz"], axis=1).astype(np.float64)  # [N, 3]
    harmonics = stacked(vertices, "f_rest_")
    harmonics = harmonics.reshape(len(means), 3, harmonics.shape[1] // 3)  # channel, coefficient
    colors = 0.5 + SH_C0 * stacked(vertices, "f_dc_")
    if harmonics.shape[2]:
        towards = means - position
        x, y, z = (towards / np.linalg.norm(towards, axis=1, keepdims=True)).T[..., None]  # [N, 1] each
        colors = colors - SH_C1 * y * harmonics[..., 0] + SH_C1 * z * harmonics[..., 1] - SH_C1 * x * harmonics[..., 2]
    opacities = 1.0 / (1.0 + np.exp(-np.asarray(vertices["opacity"], np.float64)))
    arrays = means, np.exp(stacked(vertices, "scale_")), stacked(vertices, "rot_"), opacities, colors
    return tuple(torch.from_numpy(np.ascontiguousarray(array)) for array in arrays)


@pytest.mark.parametrize("color_columns", [3, 12])
def test_the_reference_formulas_draw_the_same_picture(color_columns: int) -> None:
    shown = deformed(color_columns)
    drawn = render(
        *decoded(ply_bytes(Splats.of(shown)), CAMERA.position),  # type: ignore[arg-type]
        CAMERA,
        near=shown.rasterizer.constants.near * EXTENT,
        dilation=shown.rasterizer.constants.dilation,
        alpha_floor=shown.rasterizer.constants.alpha_floor,
        alpha_cap=shown.rasterizer.constants.alpha_cap,
        backend="reference",
    )
    picture = shown.render(CAMERA)
    assert picture[..., 3].max() > 0.5
    assert np.ptp(picture[..., 0]) > 0.3
    np.testing.assert_allclose(drawn.color.numpy().clip(0.0, 1.0), picture[..., :3], atol=1e-4)
    np.testing.assert_allclose(drawn.alpha.numpy(), picture[..., 3], atol=1e-4)


def test_the_properties_are_those_of_the_reference_in_its_order() -> None:
    plain = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    last = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    for columns, rest in ((3, 0), (12, 9)):
        data = read(ply_bytes(Splats.of(deformed(columns))))
        assert data.byte_order == "<"
        assert not data.text
        assert [p.name for p in data["vertex"].properties] == [*plain, *(f"f_rest_{i}" for i in range(rest)), *last]
        assert {p.val_dtype for p in data["vertex"].properties} == {"f4"}


def test_values_are_in_world_units_and_quaternions_of_unit_length() -> None:
    shown = deformed(12)
    vertices = read(ply_bytes(Splats.of(shown)))["vertex"]
    np.testing.assert_allclose(np.stack([vertices[a] for a in "xyz"], axis=1), shown.means, rtol=1e-6)
    np.testing.assert_allclose(np.exp(stacked(vertices, "scale_")), shown.scales, rtol=1e-5)
    quats = stacked(vertices, "rot_")
    np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1.0, atol=1e-6)
    lengths = shown.gaussians.quats.norm(dim=1, keepdim=True)
    np.testing.assert_allclose(quats, (shown.gaussians.quats / lengths).numpy(), atol=1e-6)
    assert not np.stack([vertices[n] for n in ("nx", "ny", "nz")]).any()


def test_gsplat_sees_the_same_colours() -> None:
    harmonics = pytest.importorskip("gsplat.cuda._torch_impl")._spherical_harmonics
    shown = deformed(12)
    vertices = read(ply_bytes(Splats.of(shown)))["vertex"]
    rest = stacked(vertices, "f_rest_").reshape(-1, 3, 3).transpose(0, 2, 1)  # [N, 3 coefficients, 3 channels]
    coefficients = torch.from_numpy(np.concatenate([stacked(vertices, "f_dc_")[:, None], rest], axis=1))
    towards = torch.from_numpy(np.stack([vertices[a] for a in "xyz"], axis=1).astype(np.float64) - CAMERA.position)
    towards = torch.nn.functional.normalize(towards, dim=1)
    near = torch.from_numpy(shown.normalization.points(CAMERA.position)).float()
    found = harmonics(1, towards, coefficients) + 0.5  # as gsplat's `rasterization` adds
    np.testing.assert_allclose(found.numpy(), shown.gaussians.colors_from(near).numpy(), atol=1e-5)
    assert not np.allclose(found.numpy(), shown.gaussians.colors[:, :3].numpy(), atol=1e-2)


def test_a_comment_says_where_in_the_ensemble_it_is() -> None:
    odd = replace(deformed(3), parameters={"Ω\nend_header": 0.3, "appearance": "speed"})
    for shown in (deformed(3), odd):
        (comment,) = read(ply_bytes(Splats.of(shown))).comments
        assert json.loads(comment.removeprefix("gs-surrogate ")) == shown.parameters


def test_the_light_on_surfaces_is_its_projection_onto_harmonics_of_degree_2() -> None:
    """Beside a least-squares fit of the same harmonics to the colours seen from all directions."""
    plain = deformed(3)
    lighting, turns = Lighting((0.95, 0.72, 0.35), 0.15, 0.75, 0.2, 20.0), 0.5 + np.arange(4000)
    lit = replace(plain, gaussians=replace(plain.gaussians, lighting=lighting))
    vertices = read(ply_bytes(Splats.of(lit)))["vertex"]
    rest = stacked(vertices, "f_rest_").reshape(len(lit), 3, 8)  # channel, coefficient
    polar, around = np.arccos(1 - 2 * turns / 4000), np.pi * (1 + 5**0.5) * turns
    x, y, z = np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)  # spread evenly
    second = [x * y, y * z, 2 * z * z - x * x - y * y, x * z, x * x - y * y]
    basis = np.stack(
        [SH_C0 + 0 * x, -SH_C1 * y, SH_C1 * z, -SH_C1 * x, *(f * b for f, b in zip(SH_C2, second, strict=True))], axis=1
    )
    for i in range(3):
        normals = lit.gaussians.colors[i].double().expand(4000, 3)
        seen = lighting.colors(normals, torch.tensor(np.stack([x, y, z], axis=1))).numpy()  # [4000, 3]
        expected, *_ = np.linalg.lstsq(basis, seen - 0.5, rcond=None)
        found = np.concatenate([stacked(vertices, "f_dc_")[i][None], rest[i].T])  # [9, 3]
        np.testing.assert_allclose(found, expected, atol=5e-3)
