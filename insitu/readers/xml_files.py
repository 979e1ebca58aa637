"""XML files from strangers: entities are not expanded, and a file out of all proportion is not read."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

LARGEST = 1 << 26  # bytes
MOST_ELEMENTS = 1_000_000
DEEPEST = 32


def parsed(path: Path) -> Element:
    """The root of an XML file from a stranger; raises ValueError where it is none, or out of all proportion."""
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import iterparse

    if path.stat().st_size > LARGEST:
        raise ValueError(f"it has {path.stat().st_size} bytes, more than a file that names others")
    root, depth, count = None, 0, 0
    try:
        with path.open("rb") as file:
            for event, element in iterparse(file, ("start", "end"), forbid_entities=True, forbid_external=True):
                root = element if root is None else root
                depth, count = depth + (1 if event == "start" else -1), count + 1
                if depth > DEEPEST or count > 2 * MOST_ELEMENTS:
                    raise ValueError(f"it nests more than {DEEPEST} elements, or has more than {MOST_ELEMENTS}")
    except DefusedXmlException as error:
        raise ValueError(f"its XML declares an entity, which could expand to anything: {error}") from None
    except (ParseError, LookupError) as error:
        raise ValueError(f"it is not XML: {error}") from None
    if root is None:
        raise ValueError("it is empty")
    return root
