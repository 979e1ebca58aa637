"""The form in which surrogates are stored: what each of their parts says of itself, and the checks when it is read again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.numbers import finite, fraction, row
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.words import joined_names
from surrogate.appearance.field_gaussians import AnyGaussians, FieldGaussians, FieldValues, load_gaussians
from surrogate.appearance.scale import ValueScale
from surrogate.deformation import Deformation, ValuesDeformation, load_deformation
from surrogate.deformation.bilinear import FIELD_COLUMNS, BilinearDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import GEOMETRY, Gaussians, Normalization
from surrogate.model.field_model import FieldModel
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.storage import models
from surrogate.storage.models import part
from surrogate.storage.names import joined

Fields = Mapping[str, Any]  # those of a `Surrogate`, by name
TRAINED = {"fingerprint": str, "appearance": str, "seconds": float, "steps": int, "settings": dict, "curve": list}


def stored_form(surrogate: Any) -> models.StoredModel:
    """The stored form of a `Surrogate`."""
    parts = {"gaussians": surrogate.gaussians.tensors(), "deformation": surrogate.deformation.stored()}
    parts |= {f"visualization{i}": v.stored() for i, v in enumerate(surrogate.visualizations)}
    record = {
        "schema": models.SCHEMA,
        "parameters": surrogate.space.to_json(),
        "normalization": surrogate.normalization.to_json(),
        "deformation": surrogate.deformation.record(),
        "rasterizer": surrogate.rasterizer.to_json(),
        "background": surrogate.background,
        "training": dict(surrogate.training),
        "visualizations": [v.record() for v in surrogate.visualizations],
        **surrogate.gaussians.record(),
    }
    return models.StoredModel(joined(parts), record, surrogate.encodings)


def fields_of(model: models.StoredModel) -> Fields:
    """The fields of the `Surrogate` that was stored; raises ValueError naming the part that is damaged."""
    record = model.record
    visualizations = _listed(record, "visualizations")
    names = ("gaussians", "deformation", *(f"visualization{i}" for i in range(len(visualizations))))
    parts: dict[str, dict[str, Tensor]] = {name: {} for name in names}
    for name, tensor in model.tensors.items():
        of, _, key = name.partition(".")
        with part(f"tensor {name!r}"):
            if of not in parts or not key:
                raise ValueError(f"it must belong to one of {joined_names(parts)}")
        parts[of][key] = tensor
    with part("gaussians"):
        gaussians = load_gaussians(parts["gaussians"], record.get("field"))
    with part("parameters"):
        space = ParameterSpace.from_json(_listed(record, "parameters"))
    with part("normalization"):
        normalization = Normalization.from_json(record["normalization"])
    with part("deformation"):
        deformation = load_deformation(parts["deformation"], record["deformation"])
        _check_fit(deformation, len(gaussians), len(space))
        if not isinstance(deformation, BilinearDeformation):
            raise ValueError(f"a deformation of kind {deformation.kind!r} can't follow the simulation's parameters")
        carried = isinstance(gaussians, FieldGaussians)
        if carried != (len(deformation.units) == FIELD_COLUMNS):
            raise ValueError(
                f"{FIELD_COLUMNS} units are needed where Gaussians carry values, and others where they carry colours"
            )
    with part("rasterizer"):
        rasterizer = Rasterizer.from_json(record["rasterizer"])
    with part("background"):
        background = record["background"]
        background = None if background is None else tuple(fraction(c, "a colour") for c in row(background, 3, "it"))
    with part("training"):
        _check_training(record["training"])
    loaded = []
    for i, form in enumerate(visualizations):
        with part(f"visualization {i}"):
            visualization = Visualization.load(parts[f"visualization{i}"], form)
            _check_visualization(visualization, len(gaussians), len(space), carried=carried)
            loaded.append(visualization)
    return {
        "gaussians": gaussians,
        "deformation": deformation,
        "space": space,
        "normalization": normalization,
        "rasterizer": rasterizer,
        "background": background,
        "training": record["training"],
        "encodings": model.encodings,
        "visualizations": tuple(loaded),
    }


def without_gaussians(model: FieldModel) -> Fields:
    """The fields of a `Surrogate` that an emulator of the field draws alone."""
    settings = TrainingSettings.from_record(model.training.get("settings") or {})
    base = model.appearances[0]
    tensors = {name: torch.zeros(0, width) for name, width in GEOMETRY.items()} | {"opacity_logits": torch.zeros(0)}
    gaussians: AnyGaussians
    if isinstance(base, VolumeRendering):
        scale = ValueScale.of_function(base.transfer_function)
        values = FieldValues(base.transfer_function, scale)
        gaussians = FieldGaussians.of_tensors(tensors | {"values": torch.zeros(0, 2)}, values)
    else:
        gaussians = Gaussians.of_tensors(tensors | {"colors": torch.zeros(0, 3)})
    return {
        "gaussians": gaussians,
        "deformation": BilinearDeformation.create(gaussians, len(model.space), settings),
        "space": model.space,
        "normalization": model.normalization,
        "rasterizer": Rasterizer.of(settings).for_any_device(),
        "background": model.background,
        "training": {"steps": 0, "curve": [], **model.training},
    }


def _listed(record: Mapping[str, Any], name: str) -> list[Any]:
    with part(name):
        values = record[name]
        if not isinstance(values, list) or not all(isinstance(entry, dict) for entry in values):
            raise ValueError(f"they must be a list of objects, got {type(values).__name__}")
    return values


def _check_fit(deformation: Deformation, gaussians: int, parameters: int) -> None:
    """Raise ValueError where a deformation is one of other Gaussians, or of another number of parameters."""
    for name in deformation.per_gaussian:
        rows = len(deformation.tensors()[name])
        if rows != gaussians:
            raise ValueError(f"{name} must have a row for each of {gaussians} Gaussians, got {rows}")
    count = deformation.parameters if isinstance(deformation, BilinearDeformation) else parameters
    if count != parameters:
        raise ValueError(f"it must be of {parameters} parameters, got {count}")


def _check_visualization(visualization: Visualization, gaussians: int, parameters: int, *, carried: bool) -> None:
    variation, own = visualization.variation, visualization.gaussians
    if own is not None and variation.edits_base:
        raise ValueError(f"{variation.plural} are those of the base's Gaussians, not of others")
    gaussians = gaussians if own is None else len(own)
    if visualization.deformation is not None:
        _check_fit(visualization.deformation, gaussians, parameters + len(variation.space))
    elif not carried or not variation.edits_base:
        raise ValueError(f"{variation.plural} can't be followed without a deformation")
    if visualization.deformation and isinstance(visualization.deformation, ValuesDeformation) != variation.edits_base:
        raise ValueError(f"a deformation of kind {visualization.deformation.kind!r} can't follow {variation.plural}")
    if visualization.simulation is not None:
        _check_fit(visualization.simulation, gaussians, parameters)
    names = [variation.base, *(setting.appearance for setting in variation.settings)]
    if not all(isinstance(name, str) for name in names):
        raise ValueError(f"appearances must have names, got {names[:3]}")


def _check_training(record: Any) -> None:
    """Raise ValueError where a record of training is neither empty nor of the form that reports and commands read."""
    if not isinstance(record, dict):
        raise ValueError(f"it must be an object, got {type(record).__name__}")
    if record and "settings" not in record:
        raise ValueError("settings are missing")
    for name, kind in TRAINED.items():
        if name not in record:
            continue
        value = record[name]
        if kind is float and finite(value, name) < 0.0:
            raise ValueError(f"{name} must not be negative, got {value!r}")
        if kind is not float and type(value) is not kind:
            raise ValueError(f"{name} must be of type {kind.__name__}, got {value!r}")
    choices = record.get("choices", [])
    if not isinstance(choices, list) or not all(isinstance(c, dict) and {"name", "kept"} <= set(c) for c in choices):
        raise ValueError("choices must be a list of objects with a name and what was kept")
