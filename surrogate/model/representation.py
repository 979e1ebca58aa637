"""The representations of an ensemble, and which of them validation images prefer for each kind of question."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from catalogs.files import durable
from catalogs.vocabulary.numbers import finite
from surrogate.storage.files import opened_inside

GAUSSIANS, FIELD, BOTH = "gaussians", "field", "both"
REPRESENTATIONS = GAUSSIANS, FIELD, BOTH
DRAWN = {
    GAUSSIANS: "by its Gaussians",
    FIELD: "from its emulated field",
    BOTH: "as the mean image of Gaussians and field",
}
WORDS = {GAUSSIANS: "Gaussians", FIELD: "emulated field", BOTH: "mean image of Gaussians and field"}
# Pictures of the base appearance; under another transfer function, at an isovalue, of another field (the kinds of variations).
VIEW, FUNCTION = "view", "transfer_function"
KINDS = (VIEW, FUNCTION, "isovalue", "field")
FILE = "representations.json"
MOST_BYTES = 100_000


@dataclass(frozen=True)
class RepresentationScores:
    """Scores of an ensemble's representations on validation images.

    Attributes
    ----------
    psnr : mean over validation images, by kind of question and representation.
    megabytes, milliseconds : as stored, and of a picture of the catalog's size, by representation.
    left_out : True where, for lack of validation members, views were scored on members that the emulator was fitted without.
    """

    psnr: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    megabytes: Mapping[str, float] = field(default_factory=dict)
    milliseconds: Mapping[str, float] = field(default_factory=dict)
    left_out: bool = False

    def better(self, kind: str) -> str:
        """The representation with the higher score, for want of others as for views; Gaussians where nothing tells."""
        scores = self.psnr.get(kind) or self.psnr.get(VIEW) or {}
        return max(REPRESENTATIONS, key=lambda name: scores.get(name, float("-inf")))

    def save(self, directory: str | os.PathLike[str]) -> None:
        """Write them beside the model in `directory`."""
        durable.replace(Path(directory) / FILE, json.dumps(vars(self), indent=1).encode())

    @classmethod
    def load(cls, directory: str | os.PathLike[str]) -> RepresentationScores:
        """Those saved in `directory`; none where there is no file.  Raises ValueError for a damaged one."""
        path = Path(directory) / FILE
        if not path.exists():
            return cls()
        try:
            with opened_inside(Path(directory), FILE, MOST_BYTES) as (file, size):
                values = json.loads(file.read(size))
            psnr = {str(kind): _numbers(scores) for kind, scores in values["psnr"].items()}
            sizes, speeds = _numbers(values["megabytes"]), _numbers(values["milliseconds"])
            return cls(psnr, sizes, speeds, values.get("left_out") is True)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(
                f"{path} is damaged: {error!r}; `surrogate train` writes it anew once it is deleted"
            ) from None


def _numbers(values: Mapping[str, Any]) -> dict[str, float]:
    return {name: finite(values[name], name) for name in REPRESENTATIONS if name in values}
