"""Answers that lie over a picture: where it may be wrong, and where a parameter acts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files.images import encode_png
from catalogs.vocabulary.words import one_line
from surrogate.explore.exporting.difference import ENTRIES, color_table, reach
from surrogate.explore.request import FrameRequest, MessageError
from surrogate.explore.run import Run
from surrogate.explore.server.frames import Frames

WRONG = "error"  # asks where the picture may be wrong; names of parameters ask where these act
SMALLER = 2  # times: the sides of maps
NEXT = 8  # runs that are suggested
BLUR = 1.0  # pixels: hides single Gaussians that appear or vanish
MOST_OPAQUE = 0.9  # so that the picture below stays visible


@dataclass(frozen=True, eq=False)
class Questions:
    """Questions about a run whose pictures `frames` draws, and their answers."""

    run: Run
    frames: Frames

    __repr__ = one_line

    def over(self, request: FrameRequest, about: Any) -> dict[str, Any]:
        """A map to lay over the picture of a request's first setting: a PNG with alpha, where its colours end, and its words.

        `about` is `WRONG` or the name of a parameter.  `shares` are the changes of the whole picture by each parameter, 1 for the
        largest; empty for `WRONG`.  Raises MessageError for anything else, ValueError where nobody can say.
        """
        from scipy.ndimage import gaussian_filter

        from surrogate.answers.maps import error_map
        from surrogate.answers.sensitivity import sensitivity

        setting, camera = request.settings[0], request.camera
        if setting.cut is not None:
            raise ValueError("maps are of whole pictures: reset the clip box and the slice")
        small = camera.resized(max(camera.width // SMALLER, 8), max(camera.height // SMALLER, 8))
        names = self.run.surrogate.space.names
        if about == WRONG:
            if self.frames.doubt is None:
                raise ValueError(self.frames.undoubted or "what to expect is still being measured")
            function = setting.transfer_function(self.run.surrogate) if setting.is_free else None
            values = setting.parameters if setting.is_free else setting.values
            map_, shares, unit = error_map(self.frames.doubt, values, small, function), {}, "expected error of a colour"
        elif about in names:
            if setting.is_free:
                raise ValueError("where a parameter acts is known of the trained transfer functions alone")
            surrogate = self.run.surrogate.using(setting.using) if setting.using else self.run.surrogate
            changes = sensitivity(surrogate, setting.values, small, background=request.background, compare=False)
            most = max(float(changes.of_view.max()), 1e-12)
            shares = {name: float(share) / most for name, share in zip(names, changes.of_view, strict=True)}
            map_ = gaussian_filter(changes.magnitudes[names.index(about)], BLUR)
            unit = f"change of a colour over the range of {about}"
        else:
            raise MessageError(f"a map is about {WRONG!r} or a parameter, got {str(about)[:40]!r}")
        high = reach(map_)
        return {"pictures": [_png(map_, high)], "high": high, "words": unit, "shares": shares}

    def next(self) -> dict[str, Any]:
        """Runs that would teach most, as values by parameter."""
        from surrogate.answers.next_runs import next_runs

        if self.run.catalog is None:
            raise ValueError("without its catalog nobody knows which runs there are")
        field = self.run.surrogate.field
        suggested = next_runs(self.run.catalog, None if field is None else field.emulators, NEXT)
        return {"runs": suggested.runs.tolist()}


def about_of(message: Any) -> Any:
    """The word that says what a map is to be about."""
    return message.get("about") if isinstance(message, dict) else None


def _png(map_: NDArray[np.floating], high: float) -> bytes:
    """A map (H, W) as colours that are the more opaque the larger the value."""
    shares = np.clip(map_ / high, 0.0, 1.0)
    colors = color_table()[np.minimum(shares * ENTRIES, ENTRIES - 1).astype(int)]  # [H, W, 3]
    opacity = MOST_OPAQUE * np.sqrt(shares)[..., None]
    return encode_png((255.0 * np.concatenate([colors, opacity], axis=-1) + 0.5).astype(np.uint8))
