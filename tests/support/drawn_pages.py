"""Pages that draw by themselves: opened from a file, and asked for pictures in numbers."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from surrogate import Surrogate
from surrogate.explore.exporting.page import page_bytes
from surrogate.explore.run import Run

if TYPE_CHECKING:
    from playwright.sync_api import Page

DRAW = """async ([cases, engine]) => {
  const { model } = await import("draw/local.js"), { transferOf } = await import("draw/ways.js");
  const { figureFor } = await import("draw/model.js"), { Cards } = await import("draw/cards.js");
  const { Graphics } = await import("draw/graphics.js"), { Scripts } = await import("draw/scripts.js");
  const card = figure => new Cards(figure, new Graphics(document.createElement("canvas"))), engines = new Map();
  const engineOf = figure => engine === "card" ? card(figure) : new Scripts(figure);
  return cases.map(({ parameters, camera, transfer, visualization }) => {
    const figure = figureFor(model, parameters), own = engines.get(figure) ?? engineOf(figure);
    engines.set(figure, own);
    if (visualization) own.setFunction(transferOf(figure.base, visualization));
    if (transfer) own.setFunction(transfer);
    own.setParameters(parameters);
    return textOf(own.draw(camera));
  });
}"""
FIELD = """async ([cases, engine]) => {
  const { model: { fields } } = await import("draw/local.js"), { FieldCards } = await import("draw/field_cards.js");
  const { FieldScripts } = await import("draw/field_scripts.js"), { Graphics } = await import("draw/graphics.js");
  const graphics = new Graphics(document.createElement("canvas"));
  const own = engine === "card" ? new FieldCards(fields, graphics) : new FieldScripts(fields);
  return cases.map(({ parameters, visualization, transfer, camera, cut }) => {
    own.set(parameters, visualization, transfer, cut);
    return textOf(own.draw(camera));
  });
}"""
TEXT = """() => {
  window.textOf = numbers => {
    const bytes = new Uint8Array(numbers.buffer);
    let text = "";
    for (let at = 0; at < bytes.length; at += 8192) text += String.fromCharCode(...bytes.subarray(at, at + 8192));
    return btoa(text);
  };
}"""


def opened(page: Page, surrogate: Surrogate, folder: Path, title: str = "a run", modes: int | None = None) -> list[str]:
    """Open the page of a surrogate from the file system, without a network; returns the addresses that it asks for.

    Its picture is small, as a browser without a card draws fields slowly.
    `modes` of the emulated field are those of `page_bytes`.
    """
    requests: list[str] = []
    page.context.set_offline(True)
    page.on("request", lambda request: None if request.url.startswith("data:") else requests.append(request.url))
    (folder / "page.html").write_bytes(page_bytes(Run(title, surrogate), None, modes))
    page.goto(f"{(folder / 'page.html').as_uri()}#full=256")
    page.wait_for_function("() => document.documentElement.dataset.shown")
    page.evaluate("document.querySelectorAll('.group:not(.drawer)').forEach(group => { group.open = true; })")
    return requests


def drawn(page: Page, cases: list[dict[str, Any]], engine: str) -> list[NDArray[np.float32]]:
    """Pictures (H, W, 4) of Gaussians by an engine of the page."""
    return _pictures(page, DRAW, cases, engine)


def field_drawn(page: Page, cases: list[dict[str, Any]], engine: str) -> list[NDArray[np.float32]]:
    """Pictures (H, W, 4) of the emulated field by an engine of the page."""
    return _pictures(page, FIELD, cases, engine)


def _pictures(page: Page, script: str, cases: list[dict[str, Any]], engine: str) -> list[NDArray[np.float32]]:
    page.evaluate(TEXT)
    pictures = []
    for text, case in zip(page.evaluate(script, [cases, engine]), cases, strict=True):
        height, width = case["camera"]["height"], case["camera"]["width"]
        pictures.append(np.frombuffer(base64.b64decode(text), np.float32).reshape(height, width, 4))
    return pictures


def decibels(found: NDArray[np.float32], expected: NDArray[np.float32]) -> float:
    """Of a picture of premultiplied RGBA and the expected one on white."""
    on_white = np.clip(found[..., :3].astype(np.float64) + 1.0 - found[..., 3:], 0.0, 1.0)
    return float(-10.0 * np.log10(max(((on_white - expected[..., :3]) ** 2).mean(), 1e-15)))


def places_of(surrogate: Surrogate) -> Iterator[dict[str, float]]:
    """Random parameters within the bounds, by name, the same each time."""
    random, names = np.random.default_rng(0), surrogate.space.names
    while True:
        row = surrogate.space.denormalize(random.uniform(-1.0, 1.0, len(names))).tolist()
        yield dict(zip(names, row, strict=True))


def assert_agree(page: Page, cases: list[dict[str, Any]], expected: list[NDArray[np.float32]]) -> None:
    """Both ways of the page draw cases as expected on white, of which something is seen."""
    assert max(float(picture.mean()) for picture in expected) < 0.99
    for engine, mean, worst in (("card", 95.0, 85.0), ("scripts", 80.0, 75.0)):
        found = drawn(page, cases, engine)
        scores = [decibels(*pair) for pair in zip(found, expected, strict=True)]
        assert np.mean(scores) >= mean, (engine, scores)
        assert min(scores) >= worst, (engine, scores)
