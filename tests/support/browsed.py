"""A person's view of the page, and actions on it."""

from __future__ import annotations

from typing import TYPE_CHECKING
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

Picture = tuple[str, str, int]  # member, appearance, view


def visit(page: Page, address: str) -> None:
    """Open an address afresh, also where only its hash differs from the present one."""
    page.goto("about:blank")
    page.goto(address)


def image_of(page: Page, side: int = 0) -> Locator:
    """The picture on the left (0), which is the only one unless two are compared, or on the right (1)."""
    return page.locator(f".pane[data-side='{side}'] .picture")


def picture_at(address: str) -> Picture:
    """The image at an address."""
    member, appearance, file = unquote(address).split("/")[-3:]
    return member, appearance, int(file.removesuffix(".png"))


def shown(page: Page, side: int = 0) -> Picture:
    """The image on the screen, once it is the one that the page wants."""
    page.wait_for_selector(f".pane[data-side='{side}'] .stage[aria-busy=false]")
    return picture_at(image_of(page, side).get_attribute("src") or "")


def turned(page: Page, before: Picture) -> Picture:
    """The image on the screen, once it differs from the one before."""
    page.wait_for_function(
        "before => decodeURIComponent(document.querySelector('.picture').src).endsWith(before) === false",
        arg=f"{before[0]}/{before[1]}/{before[2]:03d}.png",
    )
    return shown(page)


def composited(catalog: Catalog, background: tuple[int, int, int], of: Picture) -> NDArray[np.float64]:
    """The catalog's pixels over a colour, [H, W, 3], 0 to 255."""
    image = catalog.image(*of, dtype="float32") * 255.0
    return image[..., :3] + (1.0 - image[..., 3:] / 255.0) * np.array(background)


def drag(page: Page, start: tuple[float, float], by: tuple[float, float], steps: int = 10) -> None:
    """Press the left button at `start` of the window, move in steps, let go."""
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(start[0] + by[0], start[1] + by[1], steps=steps)
    page.mouse.up()


def slider_box(page: Page, number: int) -> tuple[float, float, float]:
    """Left end, length of travel and height in the window of the thumb of a parameter's slider."""
    box = page.locator(f"#parameter-{number}").bounding_box()
    assert box is not None
    return box["x"] + 8, box["width"] - 16, box["y"] + box["height"] / 2


def option_texts(page: Page, menu: str) -> list[str]:
    """The titles of a menu's options."""
    return page.locator(f"#{menu} option").all_text_contents()
