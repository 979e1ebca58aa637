"""Axes of climate and ocean data: which of x, y and z one is, which way is up, and in which unit it is measured.

The attributes `axis`, `standard_name`, `positive` and `units` say so; where they don't, the names that codes give their axes do.

"NetCDF Climate and Forecast (CF) Metadata Conventions", chapter 4 and appendix D.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

AXES = "xyz"
EAST = r"degrees?_?(east|e)"
NORTH = r"degrees?_?(north|n)"
DEGREES = re.compile(rf"{EAST}|{NORTH}|degrees?|deg")
PRESSURE = re.compile(r"(h|k|m|da)?pa|pascals?|hectopascals?|m(illi)?bars?|mb|d(eci)?bars?|bars?|atm|atmospheres?")
METRES = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3}
LENGTH = re.compile(r"(k|kilo|c|centi|m|milli)?(m|met(?:er|re)s?)")
STANDARD_NAMES = {
    "x": re.compile(r"(grid_)?longitude|projection_x_(angular_)?coordinate"),
    "y": re.compile(r"(grid_)?latitude|projection_y_(angular_)?coordinate"),
    "z": re.compile(
        r"(geopotential_)?height\w*|altitude|depth\w*|(\w+_)?pressure|model_level_number|(atmosphere|ocean)_\w+_coordinate\w*"
    ),
}
# In lower case: plain names, and those of NEMO, ROMS, WRF, POP, CAM, MOM, HYCOM, ERA5, COSMO, CMIP and FVCOM.
LONGITUDE = r"lon\d?|longitude|(lon|longitude)_\w+|r?lon|nav_lon"
LATITUDE = r"lat\d?|latitude|(lat|latitude)_\w+|r?lat|nav_lat"
DEPTH = r"dep|depth\w*|z_[tw](_\w+)?|(st|sw)_(ocean|edges_ocean)|nav_lev|olevel"
LEVELS_OF_PRESSURE = r"plevs?\d*|pres|pressure(_?levels?)?|isobaric\w*|[pi]full|phalf"
NAMES = {
    "x": re.compile(
        rf"x|x_?[cfhqtuvw]|i|nx|ni|nlon|easting|{LONGITUDE}|xi(_\w+)?|west_east(_stag)?|x[tu]_ocean|grid_xt?|x_?\d"
    ),
    "y": re.compile(
        rf"y|y_?[cfhqtuvw]|j|ny|nj|nlat|northing|{LATITUDE}|eta(_\w+)?|south_north(_stag)?|y[tu]_ocean|grid_yt?|y_?\d"
    ),
    "z": re.compile(
        rf"z|z_?[cfhiltuw]|k|nz|nk|[im]?lev(el)?s?_?\d*|{DEPTH}|{LEVELS_OF_PRESSURE}|height(_?\d)?|altitude|alt|elevation|z_?\d|z_?lev"
        r"|s_(rho|w)|sc_[rw]|sigma\w*|siglay|siglev|hybrid\w*|bottom_top(_stag)?|model_?level\w*|generalvertical\w*"
    ),
}


# Attributes that name arrays which describe another; those of the second kind write "term: name".
DESCRIBING = ("bounds", "climatology", "grid_mapping", "ancillary_variables", "coordinates")
DESCRIBING_BY_TERM = ("cell_measures", "formula_terms")


def described(attributes: Mapping[str, Any]) -> set[str]:
    """Names of the arrays that describe the one with these attributes: its bounds, measures, terms, mapping and quality."""
    words = [word for key in DESCRIBING for word in str(attributes.get(key, "")).split()]
    by_term = [word for key in DESCRIBING_BY_TERM for word in str(attributes.get(key, "")).split()]
    return {word.rstrip(":") for word in words} | {word for word in by_term if not word.endswith(":")}


def letter_of(name: str, attributes: Mapping[str, Any]) -> str:
    """ "x", "y" or "z" for an axis; "" where neither the attributes of its coordinate nor its name say."""
    axis = _text(attributes, "axis")
    if axis:
        return axis if axis in AXES else ""
    for letter, pattern in STANDARD_NAMES.items():
        if pattern.fullmatch(_text(attributes, "standard_name")):
            return letter
    unit = _text(attributes, "units")
    if _text(attributes, "positive") in ("up", "down") or PRESSURE.fullmatch(unit):
        return "z"
    if re.fullmatch(EAST, unit) or re.fullmatch(NORTH, unit):
        return "x" if re.fullmatch(EAST, unit) else "y"
    return next((letter for letter, pattern in NAMES.items() if pattern.fullmatch(name.lower())), "")


def points_down(name: str, attributes: Mapping[str, Any], values: NDArray[Any] | None = None) -> bool:
    """True if a vertical axis counts downwards, as depth and pressure do; negative depths are heights.

    Without coordinates (`values` None) an axis called a depth begins at the surface.
    """
    positive = _text(attributes, "positive")
    if positive in ("up", "down"):
        return positive == "down"
    if values is None:
        return bool(re.fullmatch(DEPTH, name.lower()))
    if len(values) and float(np.median(values)) < 0:
        return False
    if PRESSURE.fullmatch(_text(attributes, "units")):
        return True
    standard = _text(attributes, "standard_name")
    if STANDARD_NAMES["z"].fullmatch(standard) and standard != "model_level_number":
        return bool(
            re.fullmatch(r"depth\w*|(\w+_)?pressure|atmosphere_(hybrid_)?sigma_(pressure_)?coordinate", standard)
        )
    return bool(re.fullmatch(f"{DEPTH}|{LEVELS_OF_PRESSURE}", name.lower()))


def unit_of(name: str, attributes: Mapping[str, Any]) -> str:
    """The unit of an axis, "degrees" for all of longitude and latitude, a length as `METRES` has it; "" where unknown."""
    unit, standard = _text(attributes, "units"), _text(attributes, "standard_name")
    if not unit and re.fullmatch(r"(grid_)?(longitude|latitude)", standard):
        return "degrees"
    if DEGREES.fullmatch(unit) or (not unit and re.fullmatch(f"{LONGITUDE}|{LATITUDE}", name.lower())):
        return "degrees"
    if not unit and (standard.endswith("pressure") or re.fullmatch(LEVELS_OF_PRESSURE, name.lower())):
        return "pressure"
    length = LENGTH.fullmatch(unit)
    return f"{(length[1] or '')[:1]}m" if length else unit


def unwrapped(values: NDArray[Any], name: str, attributes: Mapping[str, Any]) -> NDArray[Any]:
    """Longitudes that go on beyond 360 or 180 degrees instead of falling back; other coordinates as they are."""
    steps = np.diff(values)
    if (steps > 0).all() or (steps < 0).all() or not np.isfinite(values).all():
        return values
    if letter_of(name, attributes) != "x" or unit_of(name, attributes) != "degrees":
        return values
    return np.unwrap(values.astype(np.float64), period=360.0)


def _text(attributes: Mapping[str, Any], key: str) -> str:
    value = attributes.get(key, "")
    value = value.ravel()[0] if isinstance(value, np.ndarray) and value.size == 1 else value  # as HDF5 has it
    return (value.decode(errors="replace") if isinstance(value, bytes) else str(value)).strip().lower()
