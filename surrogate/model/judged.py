"""A surrogate as validation members judge it, whose emulator has learnt from them since."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from surrogate.model.surrogate import Surrogate

LEARNT = ("train",)  # splits that models to be judged by validation members learn from
ALL_LEARNT = ("train", "validation")  # what emulators learn from once everything is chosen


def judged(surrogate: Surrogate, catalog: Catalog) -> Surrogate:
    """The surrogate with an emulator that has not learnt from validation members; fitted anew where it has.

    Raises ValueError where the catalog no longer keeps the coarse fields that this takes.
    """
    field = surrogate.field
    return surrogate if field is None else replace(surrogate, field=field.learning(catalog, LEARNT))


def model_key(surrogate: Surrogate, members: Sequence[Member]) -> dict[str, Any]:
    """The key of a `Record` of errors at members: the model, and the members with their splits."""
    own = [[m.name, dict(m.parameters), m.split, m.view_splits, m.appearances] for m in members]
    digest = hashlib.sha256(json.dumps(own, sort_keys=True).encode()).hexdigest()
    return {"surrogate": surrogate.digest, "members": digest}
