"""Gaussians fitted for other viewers show more of our pictures, and a file is written at the end or not at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from catalogs.vocabulary.cameras import Camera, orbit
from surrogate.evaluation.metrics import WHITE, composite, decibels
from surrogate.explore.exporting import exports
from surrogate.explore.exporting.commands import export
from surrogate.explore.exporting.refit import refitted
from surrogate.explore.exporting.splats import Splats, harmonics_of
from surrogate.explore.request import MessageError
from surrogate.explore.run import Run
from surrogate.gaussians import Normalization
from surrogate.model import DeformedGaussians
from surrogate.rasterizer import Rasterizer
from surrogate.splatting import render
from tests.support.models import plain
from tests.support.requests import message
from tests.support.surrogates import some_surrogate

CENTER, EXTENT = np.array([10.0, -20.0, 5.0]), 7.0
VIEWS = orbit(CENTER, 1.5 * EXTENT, width=32, height=32)


def medium(columns: int = 3) -> DeformedGaussians:
    """Long Gaussians that absorb along rays."""
    made = replace(some_surrogate(columns), normalization=Normalization(CENTER, EXTENT)).at(Re=1830.0, time=0.4)
    stretched = made.gaussians.log_scales + torch.tensor([0.7, 0.0, -0.7])
    gaussians = replace(made.gaussians, log_scales=stretched, medium=True)
    return replace(made, gaussians=gaussians, rasterizer=Rasterizer())


def drawn(splats: Splats, camera: Camera) -> np.ndarray:
    """A picture on white by the extension's rule but its cut at three standard deviations, by the reference in float64."""
    away = torch.from_numpy(splats.means - camera.position)
    basis = harmonics_of(torch.nn.functional.normalize(away, dim=1), splats.coefficients.shape[1])
    colors = torch.einsum("nk,nkc->nc", basis, torch.from_numpy(splats.coefficients)).clamp(min=0.0)
    tensors = (torch.from_numpy(a) for a in (splats.means, splats.scales, splats.quats, splats.opacities))
    options = {"dilation": 0.0, "alpha_floor": 1e-6, "alpha_cap": 0.9999, "backend": "reference"}
    image = render(*tensors, colors, camera, **options)  # type: ignore[arg-type]
    return image.over(WHITE).numpy().clip(0.0, 1.0)


def score(splats: Splats, own: DeformedGaussians) -> float:
    unseen = VIEWS[7::61]
    return float(
        np.mean([decibels(float(((drawn(splats, c) - composite(own.render(c), WHITE)) ** 2).mean())) for c in unseen])
    )


@pytest.mark.parametrize("columns", [3, 12])
def test_fitted_ones_gain_much_at_unseen_views(columns: int) -> None:
    own = medium(columns)
    before = Splats.of(own)
    counts: list[tuple[int, int]] = []
    after = refitted(before, own.render, VIEWS[::9], own.normalization, 300, lambda *count: counts.append(count))
    assert counts[-1] == (300, 300)
    assert len(after) == len(before)
    assert after.parameters == before.parameters
    assert score(after, own) > score(before, own) + 3.0
    again = refitted(before, own.render, VIEWS[::9], own.normalization, 5)
    twice = refitted(before, own.render, VIEWS[::9], own.normalization, 5)
    np.testing.assert_array_equal(again.means, twice.means)


def test_no_steps_change_nothing_but_digits() -> None:
    before = Splats.of(medium())
    after = refitted(before, medium().render, VIEWS[:1], medium().normalization, 0)
    np.testing.assert_allclose(after.means, before.means, atol=1e-5)
    np.testing.assert_allclose(after.opacities, before.opacities, atol=1e-5)


@pytest.mark.parametrize("ending", ["glb", "ply", "spz"])
def test_a_file_is_written_at_the_end_or_not_at_all(
    ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain().save(tmp_path / "surrogate")
    path = tmp_path / f"a.{ending}"

    def export_it(*more: str) -> int:
        return CliRunner().invoke(export, [str(tmp_path), "-o", str(path), *more]).exit_code

    def stopped(*_: object) -> Splats:
        raise KeyboardInterrupt

    with monkeypatch.context() as context:
        context.setattr(exports, "refitted", stopped)
        assert export_it() == 1
    assert not path.exists()
    assert export_it("--refit", "0") == 0
    plain_bytes = path.read_bytes()
    assert export_it("--refit", "2") == 0
    assert path.read_bytes() != plain_bytes
    assert {each.name for each in tmp_path.iterdir()} == {"surrogate", path.name}


@pytest.mark.parametrize("steps", [-1, 3001, 1.5, True, "3"])
def test_a_page_asks_for_no_more_steps_than_a_command_takes(steps: object) -> None:
    with pytest.raises(MessageError, match="refit is a whole number of steps, 0 to 3000"):
        exports.from_message(message(kind="glb", refit=steps), Run("blobs", plain()))
