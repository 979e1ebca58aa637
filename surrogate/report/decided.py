"""The number of validation images that decided something about a model: fewer than a report shows."""

from __future__ import annotations

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.variations import Variation
from surrogate.model import Surrogate
from surrogate.training.data import validation_rows
from surrogate.training.source import DECISION_IMAGES


def decided_on(surrogate: Surrogate, catalog: Catalog, variation: Variation | None = None) -> dict[str, int]:
    """The numbers of images that the "choices" about the base appearance or a variation were made on, and that were "watched".

    Zero where there were none, or the model does not say how it was trained.
    """
    training = surrogate.training
    settings = training.get("settings", {})
    named = (str(training["appearance"]),) if variation is None else tuple(s.appearance for s in variation.settings)
    watched = settings.get("validation_images", 0)

    def images(count: int) -> int:
        return len(validation_rows(catalog, named, count))

    return {
        "choices": images(DECISION_IMAGES) if watched and training.get("choices") else 0,
        "watched": images(watched) if settings.get("validation_interval") else 0,
    }
