"""Stored images of a catalog, decoded once for all that is compared with them."""

from __future__ import annotations

from dataclasses import dataclass, field
from threading import Lock
from typing import Any, Protocol

from numpy.typing import NDArray

from catalogs.files.images import to_float
from catalogs.store.catalog import Catalog, Member
from catalogs.store.plan import CatalogPlan

MOST_BYTES = 512 * 1024**2


class Images(Protocol):
    """A catalog, as far as its images are read."""

    @property
    def plan(self) -> CatalogPlan:
        """The catalog's."""

    def image(self, member: Member, appearance: str, view: int, *, dtype: str = "uint8") -> NDArray[Any]:
        """See `catalogs.store.catalog.Catalog.image`."""


@dataclass(eq=False)
class DecodedImages:
    """The images of a catalog, of which the last `most_bytes` stay decoded; several threads may read."""

    catalog: Catalog
    most_bytes: int = MOST_BYTES
    decoded: dict[tuple[str, str, int, str], NDArray[Any]] = field(default_factory=dict, repr=False)
    _changing: Lock = field(default_factory=Lock, repr=False)

    @property
    def plan(self) -> CatalogPlan:
        """See `Images`."""
        return self.catalog.plan

    def image(self, member: Member, appearance: str, view: int, *, dtype: str = "uint8") -> NDArray[Any]:
        """See `Images`."""
        dtype_on_disk = "uint8" if self.plan.image_format == "png" else dtype
        key = member.name, appearance, view, dtype_on_disk
        pixels = self.decoded.get(key)
        if pixels is None:
            pixels = self.catalog.image(member, appearance, view, dtype=dtype_on_disk)
            self._keep(key, pixels)
        return pixels if dtype_on_disk == dtype else to_float(pixels)

    def _keep(self, key: tuple[str, str, int, str], pixels: NDArray[Any]) -> None:
        with self._changing:
            self.decoded[key] = pixels
            while len(self.decoded) * pixels.nbytes > self.most_bytes:  # those of a catalog are about equally large
                self.decoded.pop(next(iter(self.decoded)))
