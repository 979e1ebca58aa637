"""The parameters that matter most to pictures, and what longer training and more members would bring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.variations import KINDS
from surrogate.answers.next_runs import learning_curve, mean_lengths
from surrogate.answers.sensitivity import sensitivity
from surrogate.evaluation.scoring import spread
from surrogate.model import Surrogate
from surrogate.model.representation import GAUSSIANS

PLACES = 4  # members at whose parameters pictures are changed
DOUBLED = 0.35, 0.7  # of the steps: after these, rates fall to zero, which raises every curve
GAINED = 0.5  # dB by this doubling, from which on longer training helps
FALLEN = 0.5  # dB below an earlier step, from which on training has lasted too long


def outlook_record(surrogate: Surrogate, catalog: Catalog) -> dict[str, Any]:
    """Importance of parameters, expected gains, and the reason where the model can't answer."""
    field, names = surrogate.field, surrogate.space.names
    record: dict[str, Any] = {"importance": _importance(surrogate, catalog), "lengths": None, "learning_curve": None}
    record |= {"gains": [], "lacks": _lacks(surrogate, catalog)}
    if field is None or not len(names):
        return record
    lengths = mean_lengths(next(iter(field.emulators.values()))).tolist()
    record["lengths"] = dict(zip(names, lengths, strict=True))
    curve, record["no_curve"] = learning_curve(catalog, field.emulators, splits=field.splits)
    if curve is not None:
        counts = sorted({10, curve.members})
        record |= {"learning_curve": curve.to_json(), "gains": [vars(curve.gain(count)) for count in counts]}
    return record


def _importance(surrogate: Surrogate, catalog: Catalog) -> dict[str, float]:
    """The mean change of a picture's colours by each parameter over its range, at some members; empty without parameters."""
    space, appearance = surrogate.space, surrogate.base_appearance

    def is_inside(member: Member) -> bool:
        return not space.outside([member.parameters[name] for name in space.names])

    members = [m for m in catalog.members if appearance in m.appearances and is_inside(m)] if len(space) else []
    background = catalog.plan.background
    changes = [
        sensitivity(surrogate, m.parameters, m.cameras[0], background=background, compare=False).of_view
        for m in (members[i] for i in spread(len(members), PLACES))
    ]
    return dict(zip(space.names, np.mean(changes, axis=0).tolist(), strict=True)) if changes else {}


def _lacks(surrogate: Surrogate, catalog: Catalog) -> str:
    """A sentence on what a model without emulated fields can't answer, and the remedy; "" where pictures show no field."""
    plan = catalog.plan
    appearance = next((a for a in plan.appearances if a.name == surrogate.base_appearance), None)
    if surrogate.field is not None or isinstance(appearance, ImportedImages) or surrogate.only == GAUSSIANS:
        return ""
    has_fields = any(member.coarse_names() for member in catalog.members)
    remedy = f"`surrogate train {catalog.path.name} -o NEW_RUN` makes one that has them"
    if not has_fields:
        remedy = (
            f"`insitu ensemble --add-coarse-fields`, which simulates again, adds fields to the catalog; then {remedy}"
        )
    return f"This model holds no emulated fields: it gives no numbers and no learning curve.  {remedy}."


def lengths_line(outlook: Mapping[str, Any]) -> str:
    """A sentence on how fast the emulated field changes with each parameter; "" without one."""
    lengths = outlook.get("lengths") or {}
    if not lengths:
        return ""
    said = ", ".join(f"{name} {lengths[name]:.2g}" for name in sorted(lengths, key=lambda name: lengths[name]))
    return (
        f"Length scales of the emulated field, in ranges of the parameter; it changes fastest with the first: {said}."
    )


def longer_training(curve: Sequence[Mapping[str, Any]]) -> str:
    """A sentence on longer training, from the PSNR of validation pictures in the stages before visualization parameters."""
    points = [(p["step"], p["psnr"]) for p in curve if p["stage"] not in KINDS and p["psnr"] is not None]
    if len(points) < 3:
        return "Whether longer training would help is not known: too few validation pictures were watched."
    steps, psnr = np.array(points).T
    if psnr.max() - psnr[-1] >= FALLEN:
        best = int(steps[psnr.argmax()])
        return f"Longer training would not help: validation pictures were {psnr.max() - psnr[-1]:.1f} dB better at step {best:,}."
    half, whole = (round(share * steps[-1]) for share in DOUBLED)
    gained = float(np.diff(np.interp([half, whole], steps, psnr))[0])
    would = "would help" if gained >= GAINED else "would hardly help"
    return f"Longer training {would} the Gaussians: steps {half:,} to {whole:,} gave {gained:+.1f} dB at validation pictures."
