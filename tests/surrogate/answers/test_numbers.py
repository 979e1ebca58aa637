"""Parameters are found by numbers of the field, in place of pictures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from surrogate.answers.number_targets import Wanted
from surrogate.answers.posterior import invert_numbers
from surrogate.cli import main
from surrogate.emulation.lattice_field import LatticeField
from surrogate.emulation.measures import Box
from surrogate.model import Surrogate
from tests.support.two_parameters import TRUE, shown

LEFT: Box = ((0.0, 0.0, 0.0), (0.5, 1.1, 1.1))


def true_field(catalog: Catalog) -> LatticeField:
    member = next(one for one in catalog.members if one.split == "test")
    coarse = member.coarse_field("")
    return LatticeField(coarse.values, None, coarse.spacing, coarse.origin)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("template", "box"),
    [
        (("mean=0",), LEFT),
        (("share_above:0.5=0", "maximum=0"), LEFT),
        (("histogram:0,0.2,0.4,0.6,2=0,0,0,0",), LEFT),
    ],
)
def test_parameters_with_such_numbers_are_found(two: Path, template: tuple[str, ...], box: Box) -> None:
    catalog, surrogate = Catalog.open(two / "catalog.cdb"), Surrogate.load(two / "surrogate")
    field = true_field(catalog)
    parts = [Wanted.of_text(text) for text in template]
    wanted = [Wanted(one.name, tuple(one.of(field, box).tolist()), one.at) for one in parts]
    answer = invert_numbers(surrogate, wanted, catalog, box=box)
    p, q = answer.parameters
    assert p.low - 0.01 <= TRUE <= p.high + 0.01
    assert not q.identified
    assert not answer.foreign
    reached = surrogate.at(answer.values).field().statistics(box).mean.value
    assert reached == pytest.approx(float(Wanted("mean", (0.0,)).of(field, box)[0]), rel=0.02)


def test_a_single_mean_may_have_several_causes_and_all_lie_in_the_interval(two: Path) -> None:
    catalog, surrogate = Catalog.open(two / "catalog.cdb"), Surrogate.load(two / "surrogate")
    means = {p: float(shown(p).mean()) for p in np.linspace(0.0, 1.0, 41)}
    wanted = means[0.5]
    causes = [p for p, mean in means.items() if abs(mean - wanted) < 1e-3 * wanted]
    (p, _) = invert_numbers(surrogate, [Wanted("mean", (wanted,))], catalog).parameters
    assert p.low <= min(causes) + 0.05
    assert p.high >= max(causes) - 0.05


def test_the_command_takes_values_and_flags_what_no_parameters_give(two: Path) -> None:
    made = CliRunner().invoke(main, ["ask", "which", str(two), "--value", "maximum=9", "--json"])
    assert made.exit_code == 0, made.output
    assert json.loads(made.output)["foreign"] is True


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ([], "say PICTUREs, or values by --value"),
        (["a:0", "--value", "mean=1"], "say PICTUREs, or values by --value"),
        (["--value", "median=1"], "a field has minimum, maximum, mean, share_above, histogram, got 'median'"),
        (["--value", "mean"], "must be such as mean=0.5"),
        (["--value", "mean=x"], "must be such as mean=0.5"),
        (["--value", "mean=nan"], "mean"),
        (["--value", "share_above=0.1"], "must be such as mean=0.5, share_above:2=0.1"),
        (["--value", "histogram:0,2,1=0.5,0.5"], "edges of bins must increase"),
        (["--value", "mean=1", "--box", "0,1"], "--box takes X0,Y0,Z0,X1,Y1,Z1"),
        (["--value", "mean=1", "--box", "5,5,5,6,6,6"], "no sample with a value lies in the box"),
    ],
)
def test_other_values_are_refused(two: Path, arguments: list[str], error: str) -> None:
    made = CliRunner().invoke(main, ["ask", "which", str(two), *arguments])
    assert made.exit_code == 1
    assert error in " ".join(made.output.split())
