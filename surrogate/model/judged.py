"""A surrogate as validation members judge it, whose emulator has learnt from them since."""

from __future__ import annotations

from dataclasses import replace

from catalogs.store.catalog import Catalog
from surrogate.model.surrogate import Surrogate

LEARNT = ("train",)  # splits that models to be judged by validation members learn from
ALL_LEARNT = ("train", "validation")  # what emulators learn from once everything is chosen


def judged(surrogate: Surrogate, catalog: Catalog) -> Surrogate:
    """The surrogate with an emulator that has not learnt from validation members; fitted anew where it has.

    Raises ValueError where the catalog no longer keeps the coarse fields that this takes.
    """
    field = surrogate.field
    return surrogate if field is None else replace(surrogate, field=field.learning(catalog, LEARNT))
