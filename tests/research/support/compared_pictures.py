"""Random pictures in the place of those that compared methods draw."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from catalogs.files import durable
from catalogs.files.images import encode_png
from research.studies.comparison.pictures import SHOWN, path_of


def keep_pictures(records: Path, name: str) -> None:
    """Keep pictures of the result `name`, or of the truth, in a scene's records."""
    random = np.random.default_rng(0)
    for number in range(len(SHOWN)):
        path = path_of(records, name, number)
        durable.make_folder(path.parent)
        path.write_bytes(encode_png(random.integers(0, 256, (20, 20, 3), dtype=np.uint8)))
