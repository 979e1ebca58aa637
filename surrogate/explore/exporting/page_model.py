"""A surrogate as browsers take it, to draw it by themselves."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

from catalogs.vocabulary.variations.isovalue import IsovalueVariation
from catalogs.vocabulary.words import one_line
from surrogate.deformation.visualization import Visualization
from surrogate.explore.exporting.page_field import field_of_page, stored_field
from surrogate.explore.facts import facts
from surrogate.explore.run import Run
from surrogate.model import FieldModel, Surrogate
from surrogate.model.field_model import scales_of
from surrogate.model.form import stored_form
from surrogate.model.representation import FIELD, GAUSSIANS, KINDS, VIEW
from surrogate.storage.models import StoredModel

DRAWN = ("normalization", "deformation", "rasterizer", "field", "background")  # of the record


@dataclass(frozen=True, eq=False)
class PageModel:
    """A surrogate as a browser takes it: `content`, JSON values, and the bytes of the Gaussians' and the emulated fields' tensors.

    Bytes are empty where there are none.
    """

    content: dict[str, Any]
    tensors: bytes
    field: bytes

    __repr__ = one_line

    @classmethod
    def of(cls, run: Run, modes: int | None = None) -> PageModel:
        """The Gaussians of a run, and its emulated field with at most a number of `modes`: 0 leaves it out.

        By default the field is there where it draws best, or alone.  Raises ValueError for a surrogate that has nothing that a
        browser can draw.
        """
        surrogate, fields = run.surrogate, field_of_page(run.surrogate, modes)
        emulation = None if fields is None else stored_field(fields, modes)
        if emulation is None and not len(surrogate.gaussians):
            raise ValueError(
                "a page is drawn by Gaussians or an emulated field, and this one would hold neither: explore the run with "
                "`surrogate explore RUN` instead"
            )
        whole = stored_form(surrogate) if len(surrogate.gaussians) else None
        tensors, field = (b"" if model is None else model.contents()[0] for model in (whole, emulation))
        return cls(_content(run, whole, emulation), tensors, field)


def average(surrogate: Surrogate, representations: Collection[str]) -> str:
    """A sentence on how good pictures by the representations that a page holds are on average; "" where nobody measured it."""
    best = surrogate.representation(VIEW)
    drawn_by = best if best in representations or len(representations) > 1 else next(iter(representations))
    psnr = surrogate.scores.psnr.get(VIEW, {}).get(drawn_by)
    return "" if psnr is None else f"Pictures of runs that training did not see: PSNR {psnr:.1f} dB on average"


def _content(run: Run, whole: StoredModel | None, emulation: StoredModel | None) -> dict[str, Any]:
    """Everything that the page must know of the model, as JSON values."""
    surrogate = run.surrogate if emulation is not None else replace(run.surrogate, field=None)
    if whole is None:
        surrogate = surrogate.using(FIELD)
    sizes = {name: model.megabytes for name, model in ((GAUSSIANS, whole), (FIELD, emulation)) if model is not None}
    page_facts = facts(replace(run, surrogate=surrogate))
    record = {} if whole is None else {name: whole.record[name] for name in DRAWN if name in whole.record}
    return {
        "facts": page_facts | {"truth": False, "exports": {"png": "PNG"}},
        "record": {
            "parameters": surrogate.space.to_json(),
            **record,
            "visualizations": [_visualization(v) for v in surrogate.visualizations],
            "emulation": emulation and emulation.record,
        },
        "megabytes": sizes,
        "quantities": [] if emulation is None or surrogate.field is None else _quantities(surrogate.field),
        "best": {kind: run.surrogate.representation(kind) for kind in KINDS},
    }


def _quantities(field: FieldModel) -> list[dict[str, Any]]:
    """Names, units and knots of scales of the emulated fields."""
    scales, of = scales_of(field.appearances), field.emulators.quantity
    return [
        {"name": of(name).name, "unit": of(name).unit, "knots": scales[name].to_json() if name in scales else None}
        for name in field.emulators
    ]


def _visualization(one: Visualization) -> dict[str, Any]:
    """A visualization's record, with what normalizes its parameters in place of all its settings."""
    variation = one.variation
    form = {"kind": variation.kind, "base": variation.base, "parameters": variation.space.to_json()}
    trained = sorted(values[0] for values in variation.trained) if variation.kind == IsovalueVariation.kind else []
    return one.record() | {"variation": form | {"trained": trained}}
