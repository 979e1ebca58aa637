"""The pages of formats: their lists of keys are the code's, and readers written after them alone read what the code wrote."""

from __future__ import annotations

import csv
import hashlib
import json
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from safetensors.numpy import load_file

import insitu
from catalogs import Catalog
from catalogs.files.images import read_image
from catalogs.store.description import DIGEST, OLDEST, OPTIONAL, PLAN, SCHEMA
from catalogs.store.plan import RESERVED_NAMES
from catalogs.store.summary import FieldSummary
from surrogate.model.representation import RepresentationScores
from surrogate.storage import models
from surrogate.storage.encoding import encode
from tests.support.emulated_models import both
from tests.support.surrogates import some_surrogate

PAGES = Path(__file__).resolve().parents[1] / "docs" / "reference"
CATALOG, MODEL = ((PAGES / f"{name}-format.md").read_text() for name in ("catalog", "model"))
Array = NDArray[Any]


def section(page: str, title: str) -> str:
    match = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE)
    assert match is not None, title
    return match[1]


def first_column(text: str) -> set[str]:
    """All names in code in the first cells of a text's tables."""
    cells = re.findall(r"^\| (.*?) \|", text, re.MULTILINE)
    return {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    path = tmp_path_factory.mktemp("catalog") / "a.cdb"
    function = insitu.TransferFunction(((0.0, 0.1, 0.3, 0.8), (1.0, 0.9, 0.2, 0.1)), ((0.0, 0.0), (1.0, 0.8)), 0.2)
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in (5, 6, 7)), indexing="ij")
    with insitu.Session(
        path,
        space={"a": (0, 1), "view": (1, 2)},
        appearances=insitu.VolumeRendering("dvr", function),
        views=insitu.ViewPlan(frequency=1, width=16, height=12),
        nan="transparent",
    ) as session:
        for a in (0.2, 0.7):
            field = np.exp(-a * (x**2 + y**2 + z**2))
            field[0, 0, :2] = np.nan
            session.render_member(field, {"a": a, "view": 1 + a}, spacing=(0.3, 0.4, 0.5), origin=(-1, -1, -1))
    return Catalog.open(path)


def test_the_keys_of_a_catalog_are_those_of_the_page(catalog: Catalog) -> None:
    listed = first_column(section(CATALOG, "`catalog.json`"))
    assert listed - {"linear"} == {"schema", "images", DIGEST, *PLAN, *OPTIONAL}
    assert set(json.loads((catalog.path / "catalog.json").read_text())) <= listed
    assert f"reads {OLDEST} to {SCHEMA} and writes {SCHEMA}" in CATALOG
    record = json.loads((catalog.members[0].path / "member.json").read_text())
    assert first_column(section(CATALOG, "`member.json`")) == {*record, "appearances"}
    assert all(name in CATALOG for name in RESERVED_NAMES)


def test_the_arrays_of_a_member_are_those_of_the_page(catalog: Catalog) -> None:
    text = section(CATALOG, "`field.npz` and `coarse.npz`")
    coarse = np.load(catalog.members[0].path / "coarse.npz")
    assert first_column(text) == {*(f.name for f in fields(FieldSummary)), *coarse.files, "field.npz", "coarse.npz"}


def digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=8).hexdigest()


def coarse_values(path: Path) -> Array:
    """After the page."""
    arrays = np.load(path)
    high, low = arrays["codes"].astype(np.int64)
    bits, d = int(arrays["bits"]), 256 * high + low
    codes = np.where(d % 2 == 0, d // 2, -(d + 1) // 2)
    for axis in range(3):
        codes = np.cumsum(codes, axis=axis) % 2**bits
    least, most = arrays["range"]
    return np.where(codes == 0, np.nan, least + (codes - 1) / (2**bits - 2) * (most - least))


def test_a_reader_after_the_page_reads_a_catalog(catalog: Catalog) -> None:
    plan = json.loads((catalog.path / "catalog.json").read_text())
    own = {key: value for key, value in plan.items() if key not in ("schema", "images", "digest")}
    assert digest(json.dumps(own, sort_keys=True).encode()) == plan["digest"]
    del own["provenance"]
    rows = list(csv.reader((catalog.path / "data.csv").read_text().splitlines()))
    assert rows[0] == ["a", "parameter_view", "appearance", "member", "view", "phi", "theta", "split", "member_split",
                       "view_split", "FILE"]  # fmt: skip
    for row in rows[1:]:
        cells = dict(zip(rows[0], row, strict=True))
        member = catalog.path / "members" / cells["member"]
        record = json.loads((member / "member.json").read_text())
        assert float(cells["parameter_view"]) == record["parameters"]["view"]
        view, images = int(cells["view"]), record["digests"]["images"][cells["appearance"]]
        data = (catalog.path / cells["FILE"]).read_bytes()
        assert digest(data) == images[16 * view : 16 * (view + 1)]
        assert record["digests"]["plan"] == digest(json.dumps(own, sort_keys=True).encode())
        splits = ("train", "validation", "test")
        assert cells["split"] == max(record["split"], plan["view_splits"][view], key=splits.index)
    straight = read_image(catalog.path / rows[1][-1])  # premultiplied by this project
    assert straight.shape == (12, 16, 4)
    for member in catalog.members:
        field = member.coarse_field()
        assert field is not None
        np.testing.assert_allclose(coarse_values(member.path / "coarse.npz"), field.values, atol=1e-7)


def test_the_keys_of_models_are_those_of_the_page(tmp_path: Path) -> None:
    some_surrogate().save(tmp_path / "colors")
    both().save(tmp_path / "both")
    listed = first_column(section(MODEL, "`model.json`"))
    record = json.loads((tmp_path / "colors" / "model.json").read_text())
    assert set(record) | {"field"} == listed
    assert record["schema"] == models.SCHEMA
    assert f"| `schema` | {models.SCHEMA} |" in MODEL
    emulated = json.loads((tmp_path / "both" / "field" / "model.json").read_text())
    text = section(MODEL, "`field/model.json`")
    assert set(emulated) <= first_column(text)
    named = set(re.findall(r"`(\w+)`", text))
    assert set(emulated["fields"][0]) <= named
    tensors = {name.split("/")[0] for name in load_file(tmp_path / "both" / "field" / "model.safetensors")}
    assert {name.removeprefix("0.") for name in tensors} <= named
    assert {f.name for f in fields(RepresentationScores)} <= set(re.findall(r"`(\w+)`", MODEL))


def decoded(folder: Path) -> tuple[dict[str, Any], dict[str, Array]]:
    """The record and the tensors of a model, after the page."""
    record = json.loads((folder / "model.json").read_text())
    content = (folder / record["tensors"]["file"]).read_bytes()
    assert hashlib.sha256(content).hexdigest() == record["tensors"]["sha256"]
    stored = load_file(folder / record["tensors"]["file"])
    tensors = {name: tensor for name, tensor in stored.items() if "/" not in name}
    for name, form in record["encodings"].items():
        codes = stored[f"{name}/codes"].astype(np.float32)
        levels = (0.0, 1.0) if form == "float16" else (stored[f"{name}/low"], stored[f"{name}/step"])
        tensors[name] = levels[0] + codes * levels[1]
    return record, tensors


def offsets(record: dict[str, Any], tensors: dict[str, Array], parameters: dict[str, float]) -> Array:
    """Of all attributes (N, C), after the pages of the format and of the method."""
    place = []
    for p in record["parameters"]:
        ends = np.array([p["low"], p["high"], parameters[p["name"]]])
        low, high, value = np.log(ends) if p.get("scale") == "log" else ends
        place.append(2 * (value - low) / (high - low) - 1)
    of = {name.removeprefix("deformation."): tensor.astype(np.float64) for name, tensor in tensors.items()}

    def silu(values: Array) -> Array:
        return values / (1 + np.exp(-values))

    first = silu(of["weights_in"] @ place + of["biases_in"])
    second = first + silu(of["weights_middle"] @ first + of["biases_middle"])
    units = np.array(record["deformation"]["units"])
    modes = np.zeros((of["latents"].shape[1], len(units)))
    modes[:, units != 0] = (of["weights_out"] @ second + of["biases_out"]).reshape(len(modes), -1)
    return of["latents"] @ modes * units


def test_a_reader_after_the_page_deforms_gaussians(tmp_path: Path) -> None:
    surrogate = some_surrogate()
    latents = encode(surrogate.deformation.latents, "uint8")
    rounded = replace(surrogate.deformation, latents=latents.decoded())
    means = encode(surrogate.gaussians.means, "float16")
    surrogate = replace(
        surrogate,
        deformation=rounded.without("quats"),
        gaussians=replace(surrogate.gaussians, means=means.decoded()),
        encodings={"deformation.latents": latents, "gaussians.means": means},
    )
    surrogate.save(tmp_path)
    record, tensors = decoded(tmp_path)
    assert record["encodings"] == {"deformation.latents": "uint8", "gaussians.means": "float16"}
    table = offsets(record, tensors, {"Re": 1700.0, "time": 0.4})
    deformed = surrogate.at(Re=1700.0, time=0.4).gaussians
    start = 0
    for name in ("means", "log_scales", "quats", "opacity_logits", "colors"):
        canonical = tensors[f"gaussians.{name}"].reshape(len(table), -1)
        width = canonical.shape[1]
        expected = canonical + table[:, start : start + width]
        found = torch.as_tensor(getattr(deformed, name)).reshape(len(table), -1)
        np.testing.assert_allclose(found.numpy(), expected, atol=2e-6, err_msg=name)
        start += width
    assert start == len(record["deformation"]["units"])
    center, extent = record["normalization"]["center"], record["normalization"]["extent"]
    np.testing.assert_allclose(
        surrogate.at(Re=1700.0, time=0.4).means,
        (tensors["gaussians.means"] + table[:, :3]) * extent + center,
        atol=1e-4,
    )
