"""Points of a curve of accuracy over minutes, made up."""

from research.benchmarks.training.curves.measured import Point
from surrogate.storage.records import Provenance

MADE = Provenance("bead", "", {"processor": "abacus", "cores": 1})


def point(minutes: float, psnr: float | None, **kinds: float) -> Point:
    """The PSNR after a number of minutes with the base appearance, and with variations by kind."""

    def cells(psnr: float | None, row: str) -> dict[str, object]:
        return {"psnr": {row: {"unseen_parameters": psnr}}}

    varied = [{"kind": kind, **cells(found, "unseen_settings")} for kind, found in kinds.items()]
    return Point(minutes, 0, 100, 10, 1.0, 60.0 * minutes, 59.0 * minutes, cells(psnr, "unseen_views"), varied, MADE)
