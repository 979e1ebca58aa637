"""From a checked request to encoded pictures: what the explorer does for every frame."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from surrogate.answers.doubt import Doubt, Interval, MemberDoubt
from surrogate.evaluation.metrics import composite
from surrogate.explore.exporting.difference import difference_of
from surrogate.explore.exporting.pictures import encode
from surrogate.explore.facts import orbit_of
from surrogate.explore.request import FrameRequest
from surrogate.explore.setting import Setting
from surrogate.explore.truth import Truth
from surrogate.model import MemberModel, Surrogate
from surrogate.model.representation import WORDS

KEPT = 32  # members at the last settings: moving the camera computes none anew


@dataclass(eq=False)
class Frames:
    """Draws requests.  `truth` is None where there is no catalog, `doubt` without one and until it is measured.

    Safe to be used from several threads.  What is drawn of a setting is kept for a while; `clear` lets it go.
    """

    surrogate: Surrogate
    truth: Truth | None = None
    doubt: Doubt | None = None
    undoubted: str = ""  # why there will be no doubt

    def __post_init__(self) -> None:
        def member(setting: Setting) -> MemberModel:
            if setting.cut is not None:  # a box that moves computes no field anew
                return setting.cut_from(self.member(setting.whole(self.surrogate)))
            return setting.member(self.surrogate)

        def doubted(setting: Setting) -> MemberDoubt:
            assert self.doubt is not None
            return setting.doubted(self.doubt)

        self.member, self._doubted = lru_cache(maxsize=KEPT)(member), lru_cache(maxsize=KEPT)(doubted)

    def clear(self) -> None:
        """Let go what is kept of settings."""
        self.member.cache_clear()
        self._doubted.cache_clear()

    def answer(self, request: FrameRequest) -> dict[str, Any]:
        """Encoded images and their descriptions, as values that a message carries.

        `pictures` are bytes: of the settings, the truth, and the difference of the first two.  `form`, `size` [width, height]
        and `drawn`, milliseconds, are of all.  `by`, words on what draws it, is of each setting, and so is `expected`, in PNG only;
        `difference` and `truth` on request.
        """
        started = time.perf_counter()
        pictures = [
            self.member(setting).render(request.camera, background=request.background)[..., :3]  # [H, W, 3]
            for setting in request.settings
        ]
        answer: dict[str, Any] = {}
        if request.truth:
            match = None if self.truth is None else self.truth.match(request.settings[0], request.camera)
            answer["truth"] = None
            if self.truth is not None and match is not None:
                pictures.append(composite(self.truth.picture(match), request.background))
                answer["truth"] = {"member": match.member.name, "view": match.view, "sentence": match.sentence}
        if (request.difference or request.truth) and len({p.shape for p in pictures}) == 1 < len(pictures):
            difference = difference_of(*pictures)
            pictures.append(difference.picture)
            answer["difference"] = {"psnr": difference.psnr, "maximum": difference.maximum, "high": difference.high}
        milliseconds = 1e3 * (time.perf_counter() - started)
        return answer | {
            "pictures": [encode(picture, request.form) for picture in pictures],
            "form": request.form,
            "size": [request.camera.width, request.camera.height],
            "expected": self.expected(request),
            "by": [WORDS[setting.drawn_by(self.surrogate)] for setting in request.settings],
            "drawn": milliseconds,
        }

    def expected(self, request: FrameRequest) -> list[dict[str, Any]] | None:
        """Of each setting as the camera sees it; None while something moves, and until it is known."""
        if request.form != "png" or (self.doubt is None and not self.undoubted):
            return None
        if self.doubt is None:
            return [Interval(why=self.undoubted).to_json() for _ in request.settings]
        return [self._doubted(setting).interval(request.camera).to_json() for setting in request.settings]

    def nearest(self, request: FrameRequest) -> dict[str, Any] | None:
        """The parameters and view of the stored image most similar to the first setting from this camera; None without one.

        `parameters`, `visualization`, and `orbit` as in `surrogate.explore.facts`.
        """
        match = None if self.truth is None else self.truth.nearest(request.settings[0], request.camera)
        if self.truth is None or match is None:
            return None
        return {
            "parameters": dict(match.member.parameters),
            "visualization": self.truth.appearances[match.appearance],
            "orbit": orbit_of(match.camera, self.truth.middle),
        }
