"""Gaussians as other viewers draw them, against our own pictures: how much a file of each kind keeps, fitted and as trained.

    python -m research.benchmarks.explorer.viewers RUN [RUN ...] [--views 8] [--steps N] [--write]

Prints Markdown.  Parameters are in the middle of their bounds, views unseen: each looks from between a stored view and its nearest
neighbour.  Files are read again here, and drawn by the rule of KHR_gaussian_splatting, "Ellipse Kernel Rendering": no
dilation, a cut at three standard deviations, colours cut at zero, sorted by distance.  The last columns are of the .glb as
most viewers draw, which add 0.3 px² to each variance: at the stored size, and at four times that.  PSNR is on white.
"""

from __future__ import annotations

import gzip
import json
import struct
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from catalogs.vocabulary.cameras import Camera
from research.benchmarks.page import RESULTS, command_line, made_by, publish, table
from surrogate.evaluation.metrics import WHITE, composite, decibels
from surrogate.evaluation.scoring import spread
from surrogate.explore.exporting.exports import GaussiansRequest
from surrogate.explore.exporting.kinds import REFIT_STEPS
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.splatting.threads import one_torch_thread

HEADER = [
    "run",
    "Gaussians",
    "as trained, .glb, dB",
    "fitted: .glb",
    ".spz",
    "MB: .glb / .spz",
    "s",
    "dilated",
    "dilated, 4 x",
]
DILATION, CUT = 0.3, 3.0
LARGER = 4
CONSTANT = 0.28209479177387814

Array = NDArray[np.float64]


def of_glb(content: bytes) -> dict[str, Array]:
    """Means, scales, rotations x, y, z, w, opacities and colours of a file whose colours are the same from everywhere."""
    (size,) = struct.unpack_from("<I", content, 12)
    document, data = json.loads(content[20 : 20 + size]), content[20 + size + 8 :]
    arrays = {}
    for name, number in document["meshes"][0]["primitives"][0]["attributes"].items():
        view = document["bufferViews"][document["accessors"][number]["bufferView"]]
        part = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        arrays[name.rpartition(":")[2]] = np.frombuffer(part, "<f4").reshape(document["accessors"][number]["count"], -1)
    return {
        "means": arrays["POSITION"] + np.array(document["nodes"][0]["translation"]),
        "scales": arrays["SCALE"].astype(float),
        "quats": arrays["ROTATION"].astype(float),
        "opacities": arrays["OPACITY"][:, 0].astype(float),
        "colors": 0.5 + CONSTANT * arrays["SH_DEGREE_0_COEF_0"].astype(float),
    }


def of_spz(content: bytes) -> dict[str, Array]:
    """The same of SPZ, version 3."""
    data = gzip.decompress(content)
    _, _, count, _, fractional, _, _ = struct.unpack_from("<IIIBBBB", data)
    place, parts = 16, []
    for width in (9, 1, 3, 3, 4):
        parts.append(np.frombuffer(data, np.uint8, count * width, place).reshape(count, width))
        place += count * width
    places = np.zeros((count, 3, 4), np.uint8)
    places[..., 1:] = parts[0].reshape(count, 3, 3)
    packed = parts[4].copy().view("<u4")[:, 0].astype(np.int64)
    quats, largest = np.zeros((count, 4)), packed >> 30
    for component in (3, 2, 1, 0):
        stored = largest != component
        sizes = (packed & 511) / 511.0 / np.sqrt(2.0) * np.where(packed & 512, -1.0, 1.0)
        quats[stored, component] = sizes[stored]
        packed = np.where(stored, packed >> 10, packed)
    quats[np.arange(count), largest] = np.sqrt(np.maximum(1.0 - (quats**2).sum(1), 0.0))
    return {
        "means": (places.view("<i4")[..., 0] >> 8) / 2.0**fractional,
        "scales": np.exp(parts[3] / 16.0 - 10.0),
        "quats": quats,
        "opacities": parts[1][:, 0] / 255.0,
        "colors": 0.5 + CONSTANT * (parts[2] / 255.0 - 0.5) / 0.15,
    }


def drawn(splats: dict[str, Array], camera: Camera, dilation: float = 0.0) -> Array:
    """The picture (H, W, 3) on white, blended back to front."""
    local = splats["means"] @ camera.rotation.T + camera.world_to_camera[:3, 3]
    axes = Rotation.from_quat(splats["quats"]).as_matrix() * splats["scales"][:, None]  # [N, 3, 3]
    x, y, z = local.T
    picture = np.ones((camera.height, camera.width, 3))
    zero = np.zeros_like(z)
    rows = [[camera.fx / z, zero, -camera.fx * x / z**2], [zero, camera.fy / z, -camera.fy * y / z**2]]
    jacobians = np.array(rows).transpose(2, 0, 1) @ camera.rotation  # [N, 2, 3]
    projected = jacobians @ axes
    covariances = projected @ projected.transpose(0, 2, 1) + dilation * np.eye(2)
    inverses = np.linalg.inv(covariances)
    reaches = CUT * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))  # [N, 2]
    centers = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=1)
    first = np.ceil(centers - reaches - 0.5).clip(0).astype(int)
    last = np.minimum(np.floor(centers + reaches - 0.5).astype(int) + 1, [camera.width, camera.height])
    colors = splats["colors"].clip(min=0.0)
    for i in np.argsort(-np.linalg.norm(local, axis=1)):
        (left, top), (right, bottom) = first[i], last[i]
        if z[i] <= 0.0 or left >= right or top >= bottom:
            continue
        dx = np.arange(left, right) + 0.5 - centers[i, 0]
        dy = (np.arange(top, bottom) + 0.5 - centers[i, 1])[:, None]
        (a, b), (_, c) = inverses[i]
        squares = a * dx * dx + 2.0 * b * dx * dy + c * dy * dy
        alphas = (splats["opacities"][i] * np.exp(-0.5 * squares) * (squares <= CUT**2))[..., None]
        part = picture[top:bottom, left:right]
        part += alphas * (colors[i] - part)
    return picture.clip(0.0, 1.0)


def between(cameras: Sequence[Camera], center: Array, count: int) -> list[Camera]:
    """Cameras halfway between some stored ones and their nearest neighbours, turned about a `center` (3,)."""
    positions, chosen = np.array([camera.position for camera in cameras]), []
    for number in spread(len(cameras), count):
        away = np.linalg.norm(positions - positions[number], axis=1)
        away[away < 1e-9] = np.inf
        one, other = cameras[number], cameras[int(away.argmin())]
        pair = Rotation.from_matrix([one.rotation, other.rotation])
        rotation = Slerp([0.0, 1.0], pair)(0.5).as_matrix()
        middles = [camera.rotation @ center + camera.world_to_camera[:3, 3] for camera in (one, other)]
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, np.mean(middles, axis=0) - rotation @ center
        chosen.append(replace(one, world_to_camera=matrix))
    return chosen


def row_of(run: Run, views: int, steps: int) -> list[str]:
    """The row of a run."""
    setting = Setting({p.name: p.middle for p in run.surrogate.space.parameters})
    member = setting.member(run.surrogate)
    cameras = between(run.cameras, run.surrogate.normalization.center, views)

    def score(splats: dict[str, Array], dilation: float = 0.0, larger: int = 1) -> float:
        sized = [camera.resized(larger * camera.width, larger * camera.height) for camera in cameras]
        pairs = [(drawn(splats, camera, dilation), composite(member.render(camera), WHITE)) for camera in sized]
        return float(np.mean([decibels(float(((ours - theirs) ** 2).mean())) for ours, theirs in pairs]))

    def content(request: Any) -> bytes:
        return bytes(request.content(run, lambda *_: None))

    trained = content(GaussiansRequest(setting, "glb"))
    started = time.process_time()
    fitted = content(GaussiansRequest(setting, "glb", steps))
    seconds = time.process_time() - started
    packed = content(GaussiansRequest(setting, "spz", steps))
    splats = of_glb(fitted)
    return [
        run.title,
        f"{len(splats['means']):,}",
        f"{score(of_glb(trained)):.1f}",
        f"{score(splats):.1f}",
        f"{score(of_spz(packed)):.1f}",
        f"{len(fitted) / 1e6:.2f} / {len(packed) / 1e6:.2f}",
        f"{seconds:.0f}",
        f"{score(splats, DILATION):.1f}",
        f"{score(splats, DILATION, LARGER):.1f}",
    ]


@one_torch_thread()
def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line("explorer.viewers", __doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--views", type=int, default=8, help="unseen views")
    parser.add_argument("--steps", type=int, default=REFIT_STEPS, help="of the fit")
    parser.add_argument("--write", action="store_true", help="write the table into docs/results/explorer.md")
    options = parser.parse_args(arguments)
    rows = [row_of(run, options.views, options.steps) for run in map(Run.open, options.runs)]
    words = f"{' '.join(map(str, options.runs))} --views {options.views} --steps {options.steps}"
    body = f"{table(HEADER, rows)}\n<sub>{made_by(f'explorer.viewers {words}')}</sub>"
    publish(body, RESULTS / "explorer.md", "viewers", write=options.write)


if __name__ == "__main__":
    main()
