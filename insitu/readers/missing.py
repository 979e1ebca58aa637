"""Missing and packed values of stored arrays, by the attributes of the netCDF Users Guide and of CF.

The rules are those of netCDF4-python (`Variable.set_auto_maskandscale`): `_FillValue`, `missing_value`, `valid_range`, `valid_min`
and `valid_max` are of the type that is stored, before `scale_factor` and `add_offset`; one that this type cannot hold marks
nothing.  In netCDF files, and there alone, the default fill value stands for what was never written.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

# "Default fill values" in the netCDF C library's netcdf.h, by numpy's kind and size.
DEFAULT_FILLS = {
    "i1": -127,
    "u1": 255,
    "i2": -32767,
    "u2": 65535,
    "i4": -2147483647,
    "u4": 4294967295,
    "i8": -9223372036854775806,
    "u8": 18446744073709551614,
    "f4": 9.969209968386869e36,
    "f8": 9.969209968386869e36,
}


def decoded(
    values: NDArray[Any], attrs: Mapping[str, Any], name: str = "", *, default_fill: bool = False
) -> NDArray[Any]:
    """Stored `values` as what they stand for: unpacked, NaN where missing; as they are where nothing is packed or missing.

    Parameters
    ----------
    name : of the array, for warnings.
    default_fill : without `_FillValue`, netCDF's default fill value marks what is missing.

    Raises ValueError where `scale_factor` or `add_offset` is not one number.
    """
    if values.dtype.kind not in "fiu":
        return values
    values = values.astype(values.dtype.newbyteorder("="), copy=False)
    dtype, values = values.dtype, _signed(values, attrs)
    missing = _missing(values, dtype, attrs, name, default_fill)
    scale, offset = (_number(attrs, key, name) for key in ("scale_factor", "add_offset"))
    if scale is not None or offset is not None:
        values = values.astype(_float_type(values.dtype, scale, offset))
        if scale is not None:
            values *= scale
        if offset is not None:
            values += offset
    if missing is None:
        return values
    is_float = values.dtype.kind == "f"
    values = np.array(values, dtype=values.dtype if is_float else _float_type(values.dtype, None, None))
    values[missing] = np.nan
    return values


def _signed(values: NDArray[Any], attrs: Mapping[str, Any]) -> NDArray[Any]:
    """Integers with the sign that the attribute _Unsigned gives them."""
    stated = attrs.get("_Unsigned")
    word = (stated.decode() if isinstance(stated, bytes) else str(stated)).lower()
    kind = {("i", "true"): "u", ("u", "false"): "i"}.get((values.dtype.kind, word))
    return values if kind is None else values.view(f"{kind}{values.dtype.itemsize}")


def _missing(
    values: NDArray[Any], dtype: np.dtype[Any], attrs: Mapping[str, Any], name: str, default_fill: bool
) -> NDArray[np.bool_] | None:
    """True where a value is missing; None where none is."""
    marks = [_stated(attrs, key, dtype, values.dtype, name) for key in ("_FillValue", "missing_value")]
    usual = DEFAULT_FILLS.get(values.dtype.str[1:]) if values.dtype == dtype else None
    if default_fill and "_FillValue" not in attrs and usual is not None:
        marks.append(np.array([usual], dtype))
    matches = [values == mark for group in marks for mark in group if mark == mark]  # NaN marks nothing but itself
    low, high = (_stated(attrs, key, dtype, values.dtype, name)[:1] for key in ("valid_min", "valid_max"))
    both = _stated(attrs, "valid_range", dtype, values.dtype, name)
    if both.size == 2:
        low, high = both[:1], both[1:]
    matches += [values < bound for bound in low] + [values > bound for bound in high]
    missing = None
    for marked in matches:
        missing = marked if missing is None else missing | marked
    return missing if missing is not None and missing.any() else None


def _stated(attrs: Mapping[str, Any], key: str, dtype: np.dtype[Any], final: np.dtype[Any], name: str) -> NDArray[Any]:
    """The numbers of an attribute in the type of the array, none where it has none or that cannot hold them."""
    if attrs.get(key) is None:
        return np.empty(0, final)
    mark = np.ravel(attrs[key])
    try:
        with np.errstate(all="ignore"):
            converted = mark.astype(dtype)
            is_same = bool(((converted == mark) | ((converted != converted) & (mark != mark))).all())
    except (TypeError, ValueError):
        is_same = False
    if is_same:
        return converted.view(final)
    if final != dtype and mark.dtype == final:  # the unsigned value itself
        return mark
    warnings.warn(
        f"{name}: {key} {attrs[key]} does not fit {dtype}: it marks nothing as missing, as in the netCDF library",
        stacklevel=2,
    )
    return np.empty(0, final)


def _number(attrs: Mapping[str, Any], key: str, name: str) -> Any:
    """The one number of an attribute; None where it is absent.  Raises ValueError for text and lists."""
    if attrs.get(key) is None:
        return None
    array = np.ravel(attrs[key])
    if array.size != 1 or array.dtype.kind not in "fiu":
        raise ValueError(f"{name}: {key} must be one number, got {attrs[key]!r}: its values can't be unpacked")
    return array[0]


def _float_type(kind: np.dtype[Any], scale: Any, offset: Any) -> np.dtype[Any]:
    """The type of unpacked values, that of `xarray.conventions.decode_cf_variable`."""
    single, double = np.dtype(np.float32), np.dtype(np.float64)
    types = {np.asarray(number).dtype for number in (scale, offset) if number is not None}
    if not types:
        return single if kind.itemsize <= (4 if kind.kind == "f" else 2) else double
    is_wide = kind.kind != "f" and kind.itemsize == 4 and offset is not None
    return double if types != {single} or scale is None or is_wide else single
