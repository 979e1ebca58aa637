"""Addresses of engines."""

from __future__ import annotations

import pytest

from catalogs.engines.address import opened


def test_no_address_is_no_engine() -> None:
    with opened(None) as engine:
        assert engine is None


@pytest.mark.parametrize(
    "address", ["", "dask://", "dask://host", "dask://:8786", "dask://h:0", "dask://h:70000", "ray://h:1"]
)
def test_what_is_no_address_is_refused_with_an_example(address: str) -> None:
    with pytest.raises(ValueError, match="takes dask://HOST:PORT"):
        opened(address).__enter__()
