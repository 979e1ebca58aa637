"""The stored form of emulators: modes in as few bits as lose nothing beside the error at parameters of no member."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.numbers import finite, positive
from surrogate.appearance.scale import ValueScale
from surrogate.emulation.components import Array
from surrogate.emulation.corners import vector
from surrogate.emulation.processes import LENGTHS, NOISES, Processes
from surrogate.storage.encoding import Encoding, encode
from surrogate.storage.models import part
from surrogate.storage.names import joined, part_of

# Rounding of the modes adds this share to the mean squared error of members that were left out.
ROUNDING = 0.01
FINER = 257.0  # times the levels of 8 bits are those of 16
FINEST_FACTOR = 1e-3
OUTLINE = "outline"
FINE, COARSE = "modes", "weak_modes"  # of 16 and 8 bits
ROUNDED = 1.0 + 1e-6  # of bounds: numbers are stored in float32


def encodings_of(
    mean: NDArray[np.floating],
    modes: NDArray[np.floating],
    residual: NDArray[np.floating],
    solid: NDArray[np.bool_] | None,
    strengths: Array,
    error: float,
    factor: float,
) -> dict[str, Encoding]:
    """Of an emulator's tensors (V,), (K, V), (V,) and (V,) with modes of coefficients of mean squares `strengths` (K,).

    `error` is the mean squared error at unseen parameters.  Rounding becomes part of the residual, and `factor`, which standard
    deviations are multiplied by, does not shrink it.
    """
    steps = np.ptp(modes, axis=1) / 255.0  # [K]
    added = steps**2 / 12.0 * strengths  # [K]
    weak = np.cumsum(added[::-1])[::-1] <= ROUNDING * error  # [K]
    fine = int(len(weak) - weak.sum())
    rounding = added[fine:].sum() + (added[:fine].sum() + (float(np.ptp(mean)) / 255.0) ** 2 / 12.0) / FINER**2
    rounding /= max(factor, FINEST_FACTOR) ** 2
    encodings = {
        "mean": encode(_tensor(mean), "uint16"),
        FINE: encode(_tensor(modes[:fine].T), "uint16"),
        COARSE: encode(_tensor(modes[fine:].T), "uint8"),
        "residual": encode(_tensor(np.sqrt(residual.astype(np.float64) ** 2 + rounding)), "uint16"),
    }
    if solid is not None:
        bits = torch.from_numpy(np.packbits(solid))
        encodings["solid"] = Encoding("uint8", bits, torch.zeros(1), torch.ones(1))
    return encodings


def decoded(encodings: Mapping[str, Encoding]) -> dict[str, Any]:
    """The emulator's `mean`, `modes` and `residual` as they are read again."""
    return _arrays({name: encoding.decoded() for name, encoding in encodings.items()})


def stored_form(emulator: Any) -> tuple[dict[str, Tensor], dict[str, Any], dict[str, Encoding]]:
    """Tensors, record and encodings of a `FieldEmulator`."""
    processes = emulator.processes
    tensors = {name: encoding.decoded() for name, encoding in emulator.encodings.items()}
    tensors |= {name: _tensor(getattr(processes, name)) for name in ("points", "coefficients", "lengths", "noises")}
    tensors["errors"] = _tensor(emulator.errors)
    record = {
        "shape": list(emulator.shape),
        "spacing": list(emulator.spacing),
        "origin": list(emulator.origin),
        "groups": processes.groups.tolist(),
        "factor": emulator.factor,
        "number_factors": dict(emulator.number_factors),
        "spread": emulator.spread,
        "scale": None if emulator.scale is None else emulator.scale.to_json(),
    }
    encodings = dict(emulator.encodings)
    if emulator.outline is not None:
        inner, record[OUTLINE], codes = stored_form(emulator.outline)
        tensors |= joined({OUTLINE: inner})
        encodings |= {f"{OUTLINE}.{name}": encoding for name, encoding in codes.items()}
    return tensors, record, encodings


def parts_of(
    tensors: Mapping[str, Tensor], record: Mapping[str, Any], encodings: Mapping[str, Encoding]
) -> dict[str, Any]:
    """The fields of the `FieldEmulator` that was stored, but for its outline; raises ValueError for what is not one."""
    with part("shape"):
        shape = tuple(record["shape"])
        if len(shape) != 3 or not all(type(side) is int and side > 0 for side in shape):
            raise ValueError(f"it must be three whole numbers from 1 on, got {shape}")
    with part("grid"):
        spacing, origin = vector(record["spacing"], "spacing"), vector(record["origin"], "origin")
        for step in spacing:
            positive(step, "spacing")
    arrays = _arrays(tensors)
    with part("processes"):
        processes = processes_of(tensors, record["groups"], len(arrays["modes"]))
        errors = tensors["errors"].double().numpy()
        _check("errors", errors, (len(processes.points),))
    size = int(np.prod(shape))
    _check("mean", arrays["mean"], (size,))
    _check("modes", arrays["modes"], (len(arrays["modes"]), size))
    _check("residual", arrays["residual"], (size,))
    solid = None
    if "solid" in tensors:
        _check("solid", tensors["solid"], ((size + 7) // 8,))
        solid = np.unpackbits(tensors["solid"].numpy().astype(np.uint8), count=size).astype(bool)
    return {
        **arrays,
        "processes": processes,
        "factor": positive(record["factor"], "factor") if record["factor"] else 0.0,
        "number_factors": {str(name): positive(f, name) for name, f in record.get("number_factors", {}).items()},
        "errors": errors,
        "spread": finite(record["spread"], "spread"),
        "shape": shape,
        "spacing": spacing,
        "origin": origin,
        "scale": None if record["scale"] is None else ValueScale.from_json(record["scale"]),
        "solid": solid,
        "encodings": {name: encoding for name, encoding in encodings.items() if not name.startswith(f"{OUTLINE}.")},
    }


def outline_of(
    tensors: Mapping[str, Tensor], record: Mapping[str, Any], encodings: Mapping[str, Encoding]
) -> tuple[dict[str, Tensor], Mapping[str, Any], dict[str, Encoding]] | None:
    """The stored outline of moving holes, as `stored_form` gives it; None where there is none."""
    if OUTLINE not in record:
        return None
    names = {name.removeprefix(f"{OUTLINE}."): e for name, e in encodings.items() if name.startswith(f"{OUTLINE}.")}
    return part_of(tensors, OUTLINE), record[OUTLINE], names


def rounded(processes: Processes) -> Processes:
    """The processes as they are read again."""
    points, coefficients, lengths, noises = (
        array.astype(np.float32).astype(np.float64)
        for array in (processes.points, processes.coefficients, processes.lengths, processes.noises)
    )
    return Processes(points, coefficients, lengths, noises, processes.groups)


def processes_of(tensors: Mapping[str, Tensor], groups: Any, count: int) -> Processes:
    """The `count` processes that were stored as these tensors and groups; raises ValueError for what is not one."""
    points, coefficients, lengths, noises = (
        tensors[name].double().numpy() for name in ("points", "coefficients", "lengths", "noises")
    )
    if points.ndim != 2 or not isinstance(groups, list) or len(groups) != count:
        raise ValueError(f"they must have points of members and {count} groups, got {groups!r}")
    if not all(type(group) is int and 0 <= group < len(noises) for group in groups):
        raise ValueError(f"groups must be whole numbers below {len(noises)}, got {groups!r}")
    _check("coefficients", coefficients, (len(points), count))
    _check("noises", noises, (len(noises),))
    _check("lengths", lengths, (len(noises), points.shape[1]))
    for name, values, (least, most) in (("lengths", lengths, LENGTHS), ("noises", noises, NOISES)):
        if not ((values >= least / ROUNDED) & (values <= most * ROUNDED)).all():
            raise ValueError(f"{name} must lie in [{least:g}, {most:g}]")
    return Processes(points, coefficients, lengths, noises, np.array(groups, dtype=np.int64))


def _arrays(tensors: Mapping[str, Tensor]) -> dict[str, Any]:
    fine, weak = tensors[FINE], tensors[COARSE]
    if fine.ndim != 2 or weak.ndim != 2 or len(fine) != len(weak):
        raise ValueError(f"modes must be of the same samples, got shapes {list(fine.shape)} and {list(weak.shape)}")
    modes = torch.cat([fine, weak], 1).T.contiguous().numpy()  # [K, V]
    return {"mean": tensors["mean"].numpy(), "modes": modes, "residual": tensors["residual"].numpy()}


def _check(name: str, values: Any, shape: tuple[int, ...]) -> None:
    if tuple(values.shape) != shape:
        raise ValueError(f"{name} must have the shape {list(shape)}, got {list(values.shape)}")


def _tensor(values: NDArray[np.floating]) -> Tensor:
    return torch.from_numpy(np.array(values, dtype=np.float32, order="C"))
