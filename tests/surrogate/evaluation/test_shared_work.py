"""Work that an evaluation shares between scores gives what each score alone would."""

import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from catalogs.files.images import premultiply
from catalogs.store.catalog import Catalog
from surrogate.evaluation.cases import Case, base_cells, cases_of
from surrogate.evaluation.metrics import TrueImage, composite, decibels, score
from surrogate.evaluation.pictures import DecodedImages
from surrogate.evaluation.predictor import SurrogatePredictor
from surrogate.evaluation.scoring import score_cases
from surrogate.evaluation.trivial import mixtures as mixing
from surrogate.evaluation.trivial.interpolation import fixed_rules
from surrogate.evaluation.trivial.mixtures import MemberPictures, Mixtures
from tests.support.blobs import Blobs, stored
from tests.support.varied_blobs import varied_surrogate

PARAMETERS = {"train": (0.0, 0.3, 0.6, 1.0), "test": (0.2, 0.5, 0.7)}


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    members = [(split, p) for split, values in PARAMETERS.items() for p in values]
    return stored(tmp_path_factory.mktemp("shared") / "a.cdb", Blobs(size=16), members=members)


def test_premultiplied_bytes_are_rounded_to_the_nearest() -> None:
    alpha, color = np.divmod(np.arange(65536), 256)
    straight = np.stack([color, color, color, alpha], axis=1).astype(np.uint8)
    nearest = np.floor(color * alpha / 255.0 + 0.5)  # 255 is odd: nothing lies halfway
    assert np.array_equal(premultiply(straight)[:, :3], np.stack([nearest] * 3, axis=1))
    assert np.array_equal(premultiply(straight)[:, 3], alpha)


@pytest.mark.parametrize("background", [None, (0.0, 0.5, 0.77)])
@pytest.mark.parametrize("dtype", ["uint8", "float32"])
def test_metrics_are_those_of_their_definitions(dtype: str, background: tuple[float, ...] | None) -> None:
    random = np.random.default_rng(3)
    truth, other = random.random((2, 12, 9, 4)).astype(np.float32)
    for image in (truth, other):
        image[:4, :, 3] = 0.0
        image[..., :3] *= image[..., 3:]
    if dtype == "uint8":
        truth = np.round(truth * 255).astype(np.uint8)
    behind = np.array(background or (1.0, 1.0, 1.0), np.float32)
    floats = truth.astype(np.float32) / 255.0 if dtype == "uint8" else truth
    a, b = (np.clip(i[..., :3] + (1.0 - i[..., 3:]) * behind, 0, 1).astype(np.float32) for i in (floats, other))
    assert np.array_equal(composite(truth, behind), a)
    squares = (a.astype(np.float64) - b) ** 2
    shown = np.stack([np.abs(i - behind).max(-1) > 2 / 255 for i in (floats[..., :3], other[..., :3])]).any(0)
    if background is None:
        shown = (floats[..., 3] > 1 / 255) | (other[..., 3] > 1 / 255)
    found = score(truth, other, background)
    assert found.squared_error == pytest.approx(squares.mean(), rel=1e-12)
    assert found.psnr_foreground == pytest.approx(decibels(squares[shown].mean()), rel=1e-12)
    alone = TrueImage(truth, background).psnr_alone(other)
    assert (alone.psnr, alone.squared_error) == (found.psnr, found.squared_error)


@pytest.mark.parametrize("most", [0, 3 * 16 * 16 * 4, 2**30], ids=["none", "three", "all"])
def test_decoded_images_are_the_catalogs_and_do_not_grow(catalog: Catalog, most: int) -> None:
    images = DecodedImages(catalog, most)
    for _ in range(2):
        for member in catalog.members:
            for view in (0, 5):
                for dtype in ("uint8", "float32"):
                    found = images.image(member, "drawn", view, dtype=dtype)
                    assert np.array_equal(found, catalog.image(member, "drawn", view, dtype=dtype))
                    assert sum(image.nbytes for image in images.decoded.values()) <= most
    assert len(images.decoded) == min(2 * len(catalog.members), most // (16 * 16 * 4))


def test_threads_share_decoded_images(catalog: Catalog, monkeypatch: pytest.MonkeyPatch) -> None:
    image = np.zeros((16, 16, 4), np.uint8)
    monkeypatch.setattr(Catalog, "image", lambda *_, **__: image)
    images, member = DecodedImages(catalog, 3 * image.nbytes), catalog.members[0]
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            for read in pool.map(lambda view: images.image(member, "drawn", view), range(20_000)):
                assert read is image
    finally:
        sys.setswitchinterval(before)
    assert len(images.decoded) == 3


@pytest.mark.parametrize("values", [1, 2**24], ids=["one by one", "together"])
def test_mixtures_are_weighted_sums_however_many_at_once(
    catalog: Catalog, values: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mixing, "MIXED_VALUES", values)
    rules, training = fixed_rules(1), [m for m in catalog.members if m.split == "train"]
    cases = cases_of(catalog.members, {"drawn": {}}, ("test",), ("train", "test"))
    points, wanted = (np.array([[2 * p - 1] for p in PARAMETERS[split]]) for split in ("train", "test"))
    weights = {p: [rule(points, wanted)[i] for rule in rules.values()] for i, p in enumerate(PARAMETERS["test"])}
    seen = 0
    for batch, draw in Mixtures(catalog, MemberPictures(catalog.plan.space, "drawn", training), rules).batches(cases):
        for case in batch:
            seen += 1
            stack = np.stack([catalog.image(m, "drawn", case.view, dtype="float32") for m in training]).astype(float)
            for picture, row in zip(draw(case), weights[case.member.parameters["p"]], strict=True):
                assert picture == pytest.approx(np.tensordot(row, stack, axes=1).clip(0, 1), abs=1e-6)
    assert seen == len(cases)


def test_members_at_the_same_place_share_the_pictures_of_a_camera(catalog: Catalog, tmp_path: Path) -> None:
    surrogate, drawn = varied_surrogate(), list[int]()
    cases: list[Case] = [c for row in base_cells(catalog, "drawn").values() for group in row.values() for c in group]

    def at(parameters: Mapping[str, float]) -> object:
        deformed = surrogate.at(parameters)

        class Counting:
            def render(self, camera: object, **how: object) -> object:
                drawn.append(id(camera))
                return deformed.render(camera, **how)  # type: ignore[arg-type]

        return Counting()

    frozen = SurrogatePredictor(at, None, lambda _: {"p": 0.5})  # type: ignore[arg-type]
    [scores] = score_cases(frozen, catalog, cases)
    assert list(scores) == cases
    assert len(drawn) == len(set(drawn)) == len({id(case.camera) for case in cases}) < len(cases)
    for case in cases[::7]:
        truth = catalog.image(case.member, "drawn", case.view)
        assert scores[case].score == score(truth, surrogate.at(p=0.5).render(case.camera), None)
