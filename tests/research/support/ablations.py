"""An ablation study of a few steps."""

from research.studies.ablation.records import AblationResult
from surrogate.settings import TrainingSettings
from tests.support.blobs import Blobs

SCENE = TrainingSettings(gaussians=40, canonical_steps=20, deformation_steps=60)
MEMBERS = (("train", 0.0), ("train", 1.0), ("validation", 0.5), ("test", 0.25))
VIEW_SPLITS = ("train", "train", "train", "validation", "test")
SMALL = Blobs(count=4, size=16)
BUDGET = 0.15


def names(results: list[AblationResult]) -> list[tuple[str, int]]:
    return [(result.variant, result.seed) for result in results]
