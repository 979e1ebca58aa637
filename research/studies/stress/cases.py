"""The hard cases: scenes, error bounds, and the reasons for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from research.studies.stress.scenes import (
    NEAR,
    at_depths,
    axes,
    cloud,
    layers,
    off_center,
    one_pixel,
    radius,
    view,
    with_every_third,
    with_lengths,
)
from surrogate.splatting import Constants, Primitives

IMAGE, GRADIENT = 1e-5, 5e-5  # usual bounds: about 100 and 500 roundings of float32
FLOOR = 1.0 / 255.0
FAR = torch.tensor([1e6, -2e6, 5e5], dtype=torch.float64)  # where float32 numbers are 0.06 to 0.13 apart
WHY_STEEP = "alpha falls from 1 to 0 within a fraction of a pixel, so the rounding of a position (4e-6 px) is visible"
STEEP: dict[str, Any] = {"image": 1e-4, "gradient": 2e-4, "why": WHY_STEEP}


@dataclass(frozen=True)
class StressCase:
    """One row of the table.

    Attributes
    ----------
    name : of the difficulty.
    scene : returns the Gaussians, float64.
    camera : returns the camera.
    image : bound of the largest error of colour (relative to the largest colour, at least 1), alpha, and depth
        (relative to the largest).
    gradient : bound of the largest error of any gradient, relative to the largest gradient of its kind.
    why : the reason for unusual bounds.
    dilation, alpha_floor : of the rasterizer.
    expected_alpha : alpha in the middle of the image, where a formula gives it.
    """

    name: str
    scene: Callable[[], Primitives]
    camera: Callable[[], Camera] = view
    image: float = IMAGE
    gradient: float = GRADIENT
    why: str = ""
    dilation: float = Constants.dilation
    alpha_floor: float = Constants.alpha_floor
    expected_alpha: float | None = None

    @property
    def constants(self) -> Constants:
        """The rasterizer's constants."""
        return Constants(NEAR, self.dilation, self.alpha_floor)


@dataclass(frozen=True)
class BitwiseCase:
    """A row whose image must be bit for bit the same without `options`, or from the tensors that `changed` makes.

    `options` are those of `surrogate.splatting.render`; `changed` converts tensors without changing their numbers.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    changed: Callable[[Tensor], Tensor] = lambda tensor: tensor


@dataclass(frozen=True)
class Refusal:
    """A row with invalid Gaussians: the error must name `attribute` and the Gaussian."""

    name: str
    attribute: str
    value: float
    row: int = 7


def cases() -> list[StressCase]:
    """All cases that must be drawn."""
    return [*_shapes(), *_places(), *_opacities(), *_numbers(), *_frames()]


def refusals() -> list[Refusal]:
    """All cases that must be refused: a non-finite number in each attribute."""
    values = {"NaN": float("nan"), "infinity": float("inf")}
    return [Refusal(f"{said} in {name}", name, value) for said, value in values.items() for name in Primitives._fields]


def agreements() -> list[BitwiseCase]:
    """All cases that must not change a bit."""
    return [
        BitwiseCase("again"),
        *(BitwiseCase(f"{threads} threads", {"threads": threads}) for threads in (1, 2, 3, 7)),
        BitwiseCase("tensors that are not contiguous", changed=_not_contiguous),
        BitwiseCase("tensors in float64", changed=lambda tensor: tensor.double()),
    ]


def _shapes() -> list[StressCase]:
    kinds = (("needles", 2), ("pancakes", 1))
    return [
        *(_thin(number, kind, power) for kind, number in kinds for power in (2, 4, 6, 8)),
        StressCase("needles, condition number 1e4, not dilated", lambda: axes(1e2, 2), dilation=0.0, **STEEP),
        StressCase("needles, condition number 1e16, not dilated", lambda: axes(1e8, 2), dilation=0.0, **STEEP),
        *(
            StressCase(f"radius {size:g} px", partial(radius, size), **(STEEP if size < 1.0 else {}))
            for size in (1e-6, 1e-3, 0.1, 1.0, 47.0)
        ),
        StressCase("radius 100 x the image", lambda: radius(4700.0)),
        StressCase("scales 0", lambda: cloud()._replace(scales=with_every_third(cloud().scales, 0.0, 0.0)), **STEEP),
        StressCase("scales 0, not dilated", lambda: cloud()._replace(scales=torch.zeros(60, 3).double()), dilation=0.0),
        StressCase(
            "scales denormal (1e-42)", lambda: cloud()._replace(scales=torch.full((60, 3), 1e-42).double()), **STEEP
        ),
        StressCase("scales up to 1e30", lambda: cloud()._replace(scales=with_every_third(cloud().scales, 1e9, 1e30))),
    ]


def _thin(thin: int, kind: str, power: int) -> StressCase:
    """Axes in the ratio 10^(power / 2) to 1; the thinnest needles are visible through dilation alone."""
    bounds = STEEP if thin == 2 and power > 2 else {}
    return StressCase(f"{kind}, condition number 1e{power}", partial(axes, 10.0 ** (power / 2), thin), **bounds)


def _places() -> list[StressCase]:
    steps, flat = torch.linspace(0.9999, 1.0001, 60, dtype=torch.float64), torch.tensor([0.0, 1.0, 1.0])
    return [
        StressCase("on the near plane, and 0.01 % to either side", lambda: at_depths(NEAR * steps)),
        StressCase("behind the camera", lambda: at_depths(torch.linspace(-5.0, 0.04, 60, dtype=torch.float64))),
        StressCase(
            "before and behind the near plane", lambda: at_depths(torch.linspace(0.01, 3.0, 60, dtype=torch.float64))
        ),
        StressCase("far off the axis, to 80 degrees", _far_off_axis),
        StressCase(
            "10,000 in one pixel, faint",
            partial(one_pixel, 10_000, (2e-4, 1e-3)),
            partial(view, 13, 9),
            alpha_floor=1e-7,
        ),
        StressCase("10,000 in one pixel, opaque", partial(one_pixel, 10_000, (0.98, 1.0)), partial(view, 13, 9)),
        StressCase("identical places", lambda: _moved(lambda means: means[:1].expand(60, 3))),
        # All in one plane across the axis of a camera that looks along x.
        StressCase("identical depths", lambda: _moved(lambda means: means * flat), partial(view, eye=(3.0, 0.0, 0.0))),
        StressCase("around 1e6, its origin subtracted in float64", lambda: _moved(lambda means: (means + FAR) - FAR)),
        StressCase(
            "around 1e6, not subtracted: against the reference of the rounded places",
            lambda: _moved(lambda means: means + FAR),
            _far_view,
        ),
        StressCase("a million units away", lambda: _moved(lambda means: means * 1e6)),
    ]


def _opacities() -> list[StressCase]:
    def with_opacities(first: float, second: float) -> Callable[[], Primitives]:
        return lambda: cloud()._replace(opacities=with_every_third(cloud().opacities, first, second))

    behind = "behind layers that let 1e-4 through, a gradient is a difference of numbers 10^4 times as large"
    return [
        StressCase("opacity 0 and denormal (1e-42)", with_opacities(0.0, 1e-42)),
        StressCase("opacity 1e-8 and 1 - 1e-7", with_opacities(1e-8, 1.0 - 1e-7)),
        StressCase("opacity 1/255, the floor itself, and next to it", with_opacities(FLOOR, FLOOR * (1 + 1e-5))),
        StressCase("opacity 1", with_opacities(1.0, 1.0)),
        *(
            StressCase(
                f"{count:,} layers of opacity {opacity:g}",
                partial(layers, count, opacity),
                partial(view, 9, 7),
                alpha_floor=1e-7,
                expected_alpha=1.0 - (1.0 - opacity) ** count,
                gradient=gradient,
                why=behind if gradient > GRADIENT else "",
            )
            for count, opacity, gradient in ((10_000, 1e-4, GRADIENT), (10_000, 9e-4, 3e-2), (100, 0.08, 1e-2))
        ),
    ]


def _numbers() -> list[StressCase]:
    def with_quats(*lengths: float) -> Callable[[], Primitives]:
        return lambda: cloud()._replace(quats=with_lengths(cloud().quats, *lengths))

    return [
        StressCase("quaternions of length 0 and 1", with_quats(0.0, 1.0)),
        StressCase("quaternions denormal (1e-39) and 1e-9", with_quats(1e-39, 1e-9)),
        StressCase("quaternions of length 1e-20 and 1e18", with_quats(1e-20, 1e18)),
        StressCase("colours from -1 to 2", lambda: cloud()._replace(colors=3.0 * cloud().colors - 1.0)),
        StressCase("a colour of 1e30", lambda: cloud()._replace(colors=with_every_third(cloud().colors, 1e30, 0.0))),
    ]


def _frames() -> list[StressCase]:
    return [
        StressCase("no Gaussian", lambda: cloud(0)),
        StressCase("one Gaussian", lambda: cloud(1)),
        StressCase("1 x 1 image", cloud, lambda: view(1, 1)),
        StressCase("1 x 130 image", cloud, lambda: view(1, 130)),
        StressCase("130 x 1 image", cloud, lambda: view(130, 1)),
        StressCase("not square, fx != fy, principal point off the middle", cloud, lambda: off_center(83, 29)),
        StressCase("a large image of few Gaussians", lambda: cloud(4, scales=(0.1, 0.3)), lambda: view(512, 384)),
    ]


def _not_contiguous(tensor: Tensor) -> Tensor:
    return torch.stack([tensor, torch.full_like(tensor, -7.0)], dim=-1)[..., 0]


def _far_off_axis() -> Primitives:
    angles = torch.linspace(-1.4, 1.4, 60, dtype=torch.float64)
    camera = view()
    forward, right = torch.tensor(camera.forward), torch.tensor(camera.rotation[0])
    places = angles.cos()[:, None] * forward + angles.sin()[:, None] * right  # [N, 3]
    return cloud()._replace(means=torch.tensor(camera.position) + 3.0 * places, scales=cloud().scales * 5.0)


def _moved(change: Callable[[Tensor], Tensor]) -> Primitives:
    return cloud()._replace(means=change(cloud().means))


def _far_view() -> Camera:
    near, far = view(), FAR.numpy()
    return Camera.look_at(near.position + far, far, vertical_fov_degrees=35.0, width=near.width, height=near.height)
