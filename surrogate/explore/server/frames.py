"""From a checked request to encoded pictures: what the explorer does for every frame."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.evaluation.metrics import composite
from surrogate.explore.exporting.difference import Difference, difference_of
from surrogate.explore.exporting.pictures import encode
from surrogate.explore.reliability.expectation import Expectation
from surrogate.explore.reliability.facts import orbit_of
from surrogate.explore.reliability.truth import Truth
from surrogate.explore.request import FrameRequest
from surrogate.explore.setting import Setting
from surrogate.model import DeformedGaussians, Surrogate

KEPT = 32  # deformed Gaussians of the last settings: moving the camera deforms nothing


@dataclass(eq=False)
class Frames:
    """Draws requests.  `truth` and `expectation` are None where there is no catalog, or not yet.

    Safe to be used from several threads.
    """

    surrogate: Surrogate
    truth: Truth | None = None
    expectation: Expectation | None = None

    def __post_init__(self) -> None:
        self._deformed = lru_cache(maxsize=KEPT)(lambda key: _setting(key).gaussians(self.surrogate))

    def deformed(self, setting: Setting) -> DeformedGaussians:
        """The Gaussians of a setting, kept for a while."""
        found: DeformedGaussians = self._deformed(_key(setting))
        return found

    def forget(self) -> None:
        """Let the kept Gaussians go."""
        self._deformed.cache_clear()

    def drawn(self, request: FrameRequest) -> list[NDArray[np.float32]]:
        """The pictures of the request's settings, opaque, (H, W, 3) each."""
        return [
            self.deformed(setting).render(request.camera, background=request.background)[..., :3]
            for setting in request.settings
        ]

    def answer(self, request: FrameRequest) -> dict[str, Any]:
        """Encoded pictures and what is said beside them, as values that a message carries.

        `pictures`: bytes of each, in the order of the settings, followed by that of the truth and of a difference;
        `form`; `size` [width, height]; `drawn` and `encoded`, milliseconds; `expected`, one per setting; `difference` and `truth`.
        """
        started = time.perf_counter()
        pictures = self.drawn(request)
        answer: dict[str, Any] = {}
        if request.difference:
            pictures.append(_compared(answer, "difference", pictures[0], pictures[1]))
        if request.truth:
            pictures += self._truth(request, pictures[0], answer)
        drawn = time.perf_counter()
        encoded = [encode(picture, request.form) for picture in pictures]
        return answer | {
            "pictures": encoded,
            "form": request.form,
            "size": [request.camera.width, request.camera.height],
            "expected": self._expected(request.settings),
            "drawn": 1e3 * (drawn - started),
            "encoded": 1e3 * (time.perf_counter() - drawn),
        }

    def nearest(self, request: FrameRequest) -> dict[str, Any] | None:
        """The stored picture that is most like the first setting from this camera; None without one.

        `parameters`, `visualization`, `orbit` as in `surrogate.explore.reliability.facts`, `member`, `view` and `split`.
        """
        if self.truth is None or not self.truth.members:
            return None
        setting = request.settings[0]
        found = self.truth.nearest_appearance(setting)
        appearance = self.truth.base if found is None else found[0]
        member, _ = self.truth.nearest_member(setting, shows=appearance)
        view, _ = self.truth.nearest_view(request.camera, member)
        stored = self.truth.stored(member, appearance, view)
        return {
            "parameters": dict(member.parameters),
            "visualization": self.truth.asked(appearance),
            "orbit": orbit_of(stored.camera, self.truth.middle),
            "member": member.name,
            "view": view,
            "split": stored.split,
        }

    def _truth(
        self, request: FrameRequest, picture: NDArray[np.float32], answer: dict[str, Any]
    ) -> list[NDArray[np.float32]]:
        stored = None if self.truth is None else self.truth.match(request.settings[0], request.camera)
        if stored is None or self.truth is None:
            answer["truth"] = None
            return []
        true = composite(self.truth.picture(stored), request.background)
        answer["truth"] = {"member": stored.member.name, "split": stored.split, "view": stored.view}
        if true.shape != picture.shape:
            answer["truth"]["size"] = [true.shape[1], true.shape[0]]
            return [true]
        return [true, _compared(answer, "difference", true, picture)]

    def _expected(self, settings: Sequence[Setting]) -> list[dict[str, Any] | None]:
        expectation = self.expectation
        if expectation is None:
            return [None for _ in settings]
        return [expectation.at(setting, self.surrogate).to_json() for setting in settings]


def _compared(
    answer: dict[str, Any], name: str, first: NDArray[np.float32], second: NDArray[np.float32]
) -> NDArray[np.float32]:
    found: Difference = difference_of(first, second)
    answer[name] = {"psnr": found.psnr, "mean": found.mean, "maximum": found.maximum, "high": found.high}
    return found.picture


def _key(setting: Setting) -> tuple[Any, ...]:
    return tuple(setting.parameters.items()), tuple(setting.visualization.items()), setting.color_map


def _setting(key: tuple[Any, ...]) -> Setting:
    parameters, visualization, color_map = key
    return Setting(dict(parameters), dict(visualization), color_map)
