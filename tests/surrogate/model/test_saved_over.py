"""A folder that a surrogate was saved into holds that one, whatever was there before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from surrogate.model import FieldModel, Surrogate
from surrogate.model.form import without_gaussians
from surrogate.model.representation import FIELD, GAUSSIANS, RepresentationScores
from tests.support.emulated import some_field_model
from tests.support.models import plain

FIELDS = some_field_model()
SCORES = RepresentationScores({"view": {GAUSSIANS: 30.0, FIELD: 40.0}})


def marked(mark: str) -> dict[str, Surrogate]:
    """Surrogates of one training: by Gaussians, by a field, by both."""
    training = {"settings": {}, "fingerprint": mark}
    gaussians = replace(plain(), training=training)
    fields: FieldModel = replace(FIELDS, training=training)
    return {
        "gaussians": gaussians,
        "field": Surrogate(**without_gaussians(fields), field=fields, scores=SCORES),
        "both": replace(gaussians, field=fields, scores=SCORES),
    }


@pytest.mark.parametrize("mark", ["same", "other"])
@pytest.mark.parametrize("later", ["gaussians", "field", "both"])
@pytest.mark.parametrize("earlier", ["gaussians", "field", "both"])
def test_it_is_the_last_one_alone(tmp_path: Path, earlier: str, later: str, mark: str) -> None:
    marked(mark)[earlier].save(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    saved = marked("same")[later]
    saved.save(tmp_path)
    loaded = Surrogate.load(tmp_path)
    assert loaded.digest == saved.digest
    assert loaded.representations == saved.representations
    assert loaded.scores == saved.scores
    assert (tmp_path / "notes.txt").read_text() == "mine"
