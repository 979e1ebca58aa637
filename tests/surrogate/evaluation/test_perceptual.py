"""The perceptual metrics against computations written here, and what happens where something is missing."""

from __future__ import annotations

import hashlib
import math
import os
import pickle
import socket
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import flip_evaluator
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from safetensors.torch import save_file
from scipy.ndimage import correlate1d

from surrogate.evaluation import perceptual
from surrogate.evaluation.perceptual import (
    CONVOLUTIONS,
    DEFINITIONS,
    LPIPS_SMALLEST,
    WEIGHTS_FILE,
    WEIGHTS_VARIABLE,
    Perceptual,
    PerceptualMetrics,
)
from surrogate.splatting.threads import one_torch_thread

Array = NDArray[np.float64]
# What the package lpips 0.1.4 carries as weights/v0.1/alex.pth.
HEADS_SHA256 = "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0"


@pytest.fixture(autouse=True)
def without_network_or_weights(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """Every test runs on a machine that has no weights and whose sockets raise, on one thread of torch."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("the network was asked")

    for name in ("socket", "create_connection", "getaddrinfo"):
        monkeypatch.setattr(socket, name, refuse)
    monkeypatch.setattr("urllib.request.urlopen", refuse)
    monkeypatch.setattr(torch.hub, "download_url_to_file", refuse)
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    monkeypatch.delenv(WEIGHTS_VARIABLE, raising=False)
    with one_torch_thread():
        yield


def alexnet_state() -> dict[str, torch.Tensor]:
    """Weights of AlexNet's shapes, drawn so that the features of all layers have about the same size."""
    random = torch.Generator().manual_seed(0)
    state = {"classifier.6.bias": torch.zeros(1000)}
    for index, shape, _, _ in CONVOLUTIONS:
        spread = math.sqrt(2.0 / math.prod(shape[1:]))
        state[f"features.{index}.weight"] = spread * torch.randn(shape, generator=random)
        state[f"features.{index}.bias"] = 0.1 * torch.randn(shape[0], generator=random)
    return state


@pytest.fixture
def metrics(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> PerceptualMetrics:
    torch.save(alexnet_state(), tmp_path / "alexnet.pth")
    monkeypatch.setenv(WEIGHTS_VARIABLE, str(tmp_path / "alexnet.pth"))
    return PerceptualMetrics.load()


def picture(height: int = 176, width: int = 192) -> NDArray[np.float32]:
    """A smooth coloured field (H, W, 3) on white, with edges."""
    y, x = np.mgrid[:height, :width] / max(height, width)
    bands = [0.5 + 0.4 * np.sin(9.0 * x * (1 + c) + 5.0 * y) for c in range(3)]
    inside = (x - 0.45) ** 2 + (y - 0.4) ** 2 < 0.12
    return np.where(inside[..., None], np.stack(bands, axis=-1), 1.0).astype(np.float32)


def noisy(image: NDArray[np.float32], deviation: float) -> NDArray[np.float32]:
    noise = np.random.default_rng(3).standard_normal(image.shape)
    return np.clip(image + deviation * noise, 0.0, 1.0).astype(np.float32)


def test_all_metrics_are_there_and_defined(metrics: PerceptualMetrics) -> None:
    assert metrics.unavailable == {}
    assert set(DEFINITIONS) == set(Perceptual.__dataclass_fields__)
    assert repr(metrics) == "PerceptualMetrics(ms_ssim, lpips, flip)"


def test_identical_pictures(metrics: PerceptualMetrics) -> None:
    result = metrics.score(picture(), picture())
    assert result.ms_ssim == pytest.approx(1.0, abs=1e-6)
    assert result.lpips == result.flip == 0.0


def test_more_noise_is_worse_by_every_metric(metrics: PerceptualMetrics) -> None:
    scores = [metrics.score(picture(), noisy(picture(), deviation)) for deviation in (0.01, 0.03, 0.1, 0.3)]
    for name, sign in (("ms_ssim", -1.0), ("lpips", 1.0), ("flip", 1.0)):
        values = sign * np.array([getattr(score, name) for score in scores])
        assert (np.diff(values) > 0.0).all(), f"{name}: {values}"


def test_all_metrics_are_symmetric(metrics: PerceptualMetrics) -> None:
    forth, back = (
        metrics.score(a, b) for a, b in ([picture(), noisy(picture(), 0.1)], [noisy(picture(), 0.1), picture()])
    )
    for name in DEFINITIONS:
        assert getattr(forth, name) == pytest.approx(getattr(back, name), rel=1e-5)


class TestMultiscaleSimilarity:
    def similarity(self, truth: Array, prediction: Array) -> float:
        """MS-SSIM of one channel (H, W), as `DEFINITIONS` says it, in float64."""
        product, powers = 1.0, (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)
        for scale, power in enumerate(powers):
            luminance, contrast = self.terms(truth, prediction)
            term = contrast if scale < 4 else luminance * contrast
            product *= max(float(term.mean()), 0.0) ** power
            truth, prediction = self.halved(truth), self.halved(prediction)
        return product

    def terms(self, a: Array, b: Array) -> tuple[Array, Array]:
        mean_a, mean_b = self.blurred(a), self.blurred(b)
        covariance = self.blurred(a * b) - mean_a * mean_b
        variances = self.blurred(a * a) - mean_a**2 + self.blurred(b * b) - mean_b**2
        luminance = (2.0 * mean_a * mean_b + 0.01**2) / (mean_a**2 + mean_b**2 + 0.01**2)
        return luminance, (2.0 * covariance + 0.03**2) / (variances + 0.03**2)

    def blurred(self, image: Array) -> Array:
        window = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
        window /= window.sum()
        return correlate1d(correlate1d(image, window, axis=0), window, axis=1)[5:-5, 5:-5]

    def halved(self, image: Array) -> Array:
        padded = np.pad(image, [(side % 2, side % 2) for side in image.shape])
        height, width = (side // 2 for side in padded.shape)
        return padded[: 2 * height, : 2 * width].reshape(height, 2, width, 2).mean(axis=(1, 3))

    @pytest.mark.parametrize("size", [(176, 192), (161, 170), (200, 256)])
    @pytest.mark.parametrize("deviation", [0.02, 0.2])
    def test_it_is_that_of_the_definition(
        self, metrics: PerceptualMetrics, size: tuple[int, int], deviation: float
    ) -> None:
        a, b = picture(*size), noisy(picture(*size), deviation)
        expected = np.mean([self.similarity(a[..., c].astype(float), b[..., c].astype(float)) for c in range(3)])
        assert metrics.score(a, b).ms_ssim == pytest.approx(expected, abs=2e-5)

    def test_opposite_structure_counts_as_nothing(self, metrics: PerceptualMetrics) -> None:
        board = np.indices((176, 176)).sum(axis=0) % 2
        image = np.repeat(board[..., None], 3, axis=2).astype(np.float32)
        assert metrics.score(image, 1.0 - image).ms_ssim == 0.0


class TestLearnedDistance:
    def distance(self, truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> float:
        """LPIPS with the weights of `alexnet_state` by loops over numpy arrays in float64."""
        state = {name: tensor.numpy().astype(np.float64) for name, tensor in alexnet_state().items()}
        total = 0.0
        for layer, (a, b) in enumerate(zip(self.features(truth, state), self.features(prediction, state), strict=True)):
            a, b = (features / np.linalg.norm(features, axis=2, keepdims=True).clip(1e-30) for features in (a, b))
            total += float((((a - b) ** 2) @ self.head(layer)).mean())
        return total

    def head(self, layer: int) -> Array:
        path = Path(perceptual.importlib.util.find_spec("torchmetrics").submodule_search_locations[0])
        state = torch.load(path / "functional/image/lpips_models/alex.pth", map_location="cpu", weights_only=True)
        return state[f"lin{layer}.model.1.weight"].numpy().astype(np.float64).reshape(-1)

    def features(self, image: NDArray[np.float32], state: dict[str, Array]) -> list[Array]:
        """Rectified features (h, w, C) of torchvision's AlexNet, whose layers are written out here."""
        x = (image * 2.0 - 1.0 + np.array([0.030, 0.088, 0.188])) / np.array([0.458, 0.448, 0.450])
        first = self.convolved(x, state, 0, stride=4, padding=2)
        second = self.convolved(self.pooled(first), state, 3, stride=1, padding=2)
        third = self.convolved(self.pooled(second), state, 6, stride=1, padding=1)
        fourth = self.convolved(third, state, 8, stride=1, padding=1)
        return [first, second, third, fourth, self.convolved(fourth, state, 10, stride=1, padding=1)]

    def convolved(self, x: Array, state: dict[str, Array], index: int, *, stride: int, padding: int) -> Array:
        weights = state[f"features.{index}.weight"]
        padded = np.pad(x, ((padding, padding), (padding, padding), (0, 0)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, weights.shape[2:], axis=(0, 1))[::stride, ::stride]
        found = np.einsum("hwcij,ocij->hwo", windows, weights, optimize=True) + state[f"features.{index}.bias"]
        return np.maximum(found, 0.0)

    def pooled(self, x: Array) -> Array:
        return np.lib.stride_tricks.sliding_window_view(x, (3, 3), axis=(0, 1))[::2, ::2].max(axis=(3, 4))

    @pytest.mark.parametrize("size", [(64, 80), (LPIPS_SMALLEST, 45)])
    def test_it_is_that_of_the_definition(self, metrics: PerceptualMetrics, size: tuple[int, int]) -> None:
        a, b = picture(*size), noisy(picture(*size), 0.1)
        expected = self.distance(a, b)
        assert expected > 0.001
        assert metrics.score(a, b).lpips == pytest.approx(expected, rel=1e-4)

    def test_the_heads_are_those_of_the_package_lpips(self) -> None:
        package = perceptual.importlib.util.find_spec(perceptual.HEADS_PACKAGE)
        content = (Path(package.submodule_search_locations[0]) / perceptual.HEADS_FILE).read_bytes()
        assert hashlib.sha256(content).hexdigest() == HEADS_SHA256

    def test_weights_are_found_in_the_cache_of_torch_and_as_safetensors(
        self, metrics: PerceptualMetrics, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        pair = picture(64, 64), noisy(picture(64, 64), 0.1)
        expected = metrics.score(*pair).lpips
        save_file(alexnet_state(), tmp_path / "alexnet.safetensors")
        monkeypatch.setenv(WEIGHTS_VARIABLE, str(tmp_path / "alexnet.safetensors"))
        assert PerceptualMetrics.load().score(*pair).lpips == expected
        monkeypatch.delenv(WEIGHTS_VARIABLE)
        cache = tmp_path / "torch" / "hub" / "checkpoints"
        cache.mkdir(parents=True)
        torch.save(alexnet_state(), cache / WEIGHTS_FILE)
        assert PerceptualMetrics.load().score(*pair).lpips == expected


class TestFlip:
    def uniform(self, a: Array, b: Array) -> float:
        """FLIP of two pictures of one sRGB colour each, where its filters and its edges and points do nothing."""
        powered = self.hyab(self.adjusted(a), self.adjusted(b)) ** 0.7
        most = self.hyab(self.adjusted(np.array([0.0, 1.0, 0.0])), self.adjusted(np.array([0.0, 0.0, 1.0]))) ** 0.7
        bend = 0.4 * most
        if powered < bend:
            return 0.95 / bend * powered
        return 0.95 + 0.05 * (powered - bend) / (most - bend)

    def hyab(self, a: Array, b: Array) -> float:
        return float(abs(a[0] - b[0]) + np.hypot(a[1] - b[1], a[2] - b[2]))

    def adjusted(self, srgb: Array) -> Array:
        """CIELAB under D65 of an sRGB colour, its chroma scaled by lightness (the Hunt effect)."""
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        to_xyz = np.array(
            [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
        )
        ratio = (to_xyz @ linear) / (to_xyz @ np.ones(3))
        cubic = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
        lightness = 116.0 * cubic[1] - 16.0
        chroma = np.array([500.0 * (cubic[0] - cubic[1]), 200.0 * (cubic[1] - cubic[2])])
        return np.array([lightness, *(0.01 * lightness * chroma)])

    @pytest.mark.parametrize(
        ("a", "b"),
        [
            ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
            ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
            ((0.8, 0.2, 0.1), (0.7, 0.25, 0.1)),
            ((0.5, 0.5, 0.5), (0.52, 0.5, 0.5)),
        ],
    )
    def test_it_is_that_of_the_definition_for_uniform_colours(
        self, metrics: PerceptualMetrics, a: tuple[float, ...], b: tuple[float, ...]
    ) -> None:
        pair = [np.broadcast_to(np.array(colour, np.float32), (40, 48, 3)) for colour in (a, b)]
        assert metrics.score(*pair).flip == pytest.approx(self.uniform(np.array(a), np.array(b)), abs=2e-4)

    def test_it_takes_the_viewer_for_one_at_67_pixels_per_degree(self, metrics: PerceptualMetrics) -> None:
        a, b = picture(), noisy(picture(), 0.1)
        there, nearer = (
            flip_evaluator.evaluate(a, b, "LDR", parameters={"ppd": 3840 * math.pi / 180 * metres})[1]
            for metres in (1.0, 0.5)
        )
        assert metrics.score(a, b).flip == pytest.approx(there, rel=1e-6)
        assert nearer > 1.05 * there

    def test_a_line_is_seen_where_it_appears(self, metrics: PerceptualMetrics) -> None:
        blank, line = np.ones((48, 48, 3), np.float32), np.ones((48, 48, 3), np.float32)
        line[:, 24] = 0.0
        assert 1 / 48 < metrics.score(blank, line).flip < 0.5


class TestSmallPictures:
    def test_metrics_that_need_more_pixels_are_nan(self, metrics: PerceptualMetrics) -> None:
        for side in (64, 128, 160):
            result = metrics.score(picture(side, 200), noisy(picture(side, 200), 0.1))
            assert math.isnan(result.ms_ssim)
            assert result.lpips > 0.0
            assert result.flip > 0.0

    def test_tiny_pictures_still_have_a_flip(self, metrics: PerceptualMetrics) -> None:
        result = metrics.score(picture(40, LPIPS_SMALLEST - 1), picture(40, LPIPS_SMALLEST - 1))
        assert math.isnan(result.ms_ssim)
        assert math.isnan(result.lpips)
        assert result.flip == 0.0


class TestMissing:
    def test_weights_are_asked_for_and_never_downloaded(self, tmp_path: Path) -> None:
        metrics = PerceptualMetrics.load()
        assert list(metrics.unavailable) == ["lpips"]
        reason = metrics.unavailable["lpips"]
        assert str(tmp_path / "torch" / "hub" / "checkpoints" / WEIGHTS_FILE) in reason
        assert WEIGHTS_VARIABLE in reason
        assert reason in repr(metrics)
        result = metrics.score(picture(), noisy(picture(), 0.1))
        assert result.lpips is None
        assert result.ms_ssim is not None
        assert result.flip is not None
        assert not (tmp_path / "torch").exists()

    def test_a_wrong_path_is_named(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv(WEIGHTS_VARIABLE, str(tmp_path / "nowhere.pth"))
        assert str(tmp_path / "nowhere.pth") in PerceptualMetrics.load().unavailable["lpips"]

    def test_a_pickle_with_code_is_not_run(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        class Payload:
            def __reduce__(self) -> tuple[object, tuple[str]]:
                return os.mkdir, (str(tmp_path / "ran"),)

        (tmp_path / "plain.pth").write_bytes(pickle.dumps(Payload(), protocol=2))
        torch.save({"features.0.weight": Payload()}, tmp_path / "saved.pth")
        for name in ("plain.pth", "saved.pth"):
            monkeypatch.setenv(WEIGHTS_VARIABLE, str(tmp_path / name))
            assert name in PerceptualMetrics.load().unavailable["lpips"]
        assert not (tmp_path / "ran").exists()

    @pytest.mark.parametrize("name", ["empty.pth", "empty.safetensors"])
    def test_a_damaged_file_is_named(self, name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        (tmp_path / name).write_bytes(b"")
        monkeypatch.setenv(WEIGHTS_VARIABLE, str(tmp_path / name))
        assert str(tmp_path / name) in PerceptualMetrics.load().unavailable["lpips"]

    def test_weights_of_another_network_are_refused(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        state = alexnet_state() | {"features.3.weight": torch.zeros(128, 64, 3, 3)}
        torch.save(state, tmp_path / "other.pth")
        monkeypatch.setenv(WEIGHTS_VARIABLE, str(tmp_path / "other.pth"))
        assert "features.3.weight" in PerceptualMetrics.load().unavailable["lpips"]

    @pytest.mark.parametrize(
        ("metric", "module"), [("ms_ssim", "pytorch_msssim"), ("lpips", "torchmetrics"), ("flip", "flip_evaluator")]
    )
    def test_a_package_that_is_not_installed_is_named(
        self, metric: str, module: str, metrics: PerceptualMetrics, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(sys.modules, module, None)
        missing = PerceptualMetrics.load()
        assert list(missing.unavailable) == [metric]
        assert module.replace("_", "-") in missing.unavailable[metric]
        assert "gs-surrogate[metrics]" in missing.unavailable[metric]
        assert getattr(missing.score(picture(), picture()), metric) is None


@pytest.mark.slow
def test_two_threads_find_what_one_finds(metrics: PerceptualMetrics) -> None:
    pairs = [(picture(), noisy(picture(), 0.02 * (1 + number))) for number in range(8)]
    alone = [metrics.score(*pair) for pair in pairs]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda pair: metrics.score(*pair), pairs))
    for name in DEFINITIONS:
        values = [[getattr(score, name) for score in scores] for scores in (alone, together)]
        assert values[0] == pytest.approx(values[1], rel=1e-6)


@pytest.mark.parametrize("shape", [(64, 64, 4), (64, 64), (64, 60, 3)])
def test_pictures_of_other_shapes_are_refused(metrics: PerceptualMetrics, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"\(H, W, 3\)"):
        metrics.score(np.zeros(shape, np.float32), np.zeros((64, 64, 3), np.float32))
