"""A trained model on disk: `model.safetensors` holds its tensors, `model.json` all else."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import safetensors.torch
import torch
from torch import Tensor

from catalogs import durable
from catalogs.words import one_line
from surrogate.storage.encoding import Encoding

SCHEMA = 4  # 1 had no encodings, 2 no visualization parameters, 3 no fields
WITHOUT_FIELDS = 3
TENSORS, RECORD = "model.safetensors", "model.json"
SEPARATOR = "/"  # between the name of an encoded tensor and that of its part

Model = TypeVar("Model")


@dataclass(frozen=True, eq=False)
class StoredModel:
    """What a model's files say.

    Attributes
    ----------
    tensors : in float32, by name.
    record : JSON values that describe the model.
    encodings : of tensors that are stored in fewer bits, by name; one that does not decode to its tensor is not used.
    """

    tensors: Mapping[str, Tensor]
    record: Mapping[str, Any] = field(default_factory=dict)
    encodings: Mapping[str, Encoding] = field(default_factory=dict)

    __repr__ = one_line

    def save(self, directory: str | os.PathLike[str]) -> None:
        """Write the tensors and then the record, which makes it a model, into `directory`."""
        directory = Path(directory)
        directory.mkdir(parents=True, exist_ok=True)
        content, record = self._files()
        durable.replace(directory / TENSORS, content)
        durable.replace(directory / RECORD, json.dumps(record, indent=1).encode())

    @property
    def digest(self) -> str:
        """A SHA-256 over the record, which holds that of the tensors."""
        _, record = self._files()
        return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()

    @property
    def megabytes(self) -> float:
        """Size of the tensors as they are stored, 10^6 bytes."""
        return sum(tensor.numel() * tensor.element_size() for tensor in self._encoded()[0].values()) / 1e6

    def _files(self) -> tuple[bytes, dict[str, Any]]:
        """The bytes of the tensors' file, and the values of the record's."""
        tensors, forms = self._encoded()
        content = safetensors.torch.save({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()})
        files = {"tensors": {"file": TENSORS, "sha256": hashlib.sha256(content).hexdigest()}, "encodings": forms}
        return content, {**self.record, **files}

    def _encoded(self) -> tuple[dict[str, Tensor], dict[str, str]]:
        """The tensors of the file, and the format of each that is encoded, by name."""
        found, forms = dict[str, Tensor](), dict[str, str]()
        for name, tensor in self.tensors.items():
            encoding = self.encodings.get(name)
            if encoding is not None and torch.equal(encoding.decoded(), tensor.cpu()):
                found |= {f"{name}{SEPARATOR}{part}": t for part, t in encoding.tensors().items()}
                forms[name] = encoding.form
            else:
                found[name] = tensor
        return found, forms


def exists(directory: str | os.PathLike[str]) -> bool:
    """Whether `directory` holds a whole model."""
    return (Path(directory) / RECORD).is_file()


def load(directory: str | os.PathLike[str], make: Callable[[StoredModel], Model]) -> Model:
    """What `make` makes of the model in `directory`.

    Raises FileNotFoundError where there is none, ValueError for one of a newer schema or whose files are damaged.
    """
    directory = Path(directory)
    path = directory / RECORD
    if not path.is_file():
        raise FileNotFoundError(f"there is no trained surrogate in {directory}: {path} is missing")
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if record["schema"] > SCHEMA:
            raise ValueError(f"its schema is {record['schema']}, this version reads up to {SCHEMA}: update it")
        content = (directory / record["tensors"]["file"]).read_bytes()
        if hashlib.sha256(content).hexdigest() != record["tensors"]["sha256"]:
            raise ValueError(f"{record['tensors']['file']} does not belong to it or is damaged: train anew")
        tensors, encodings = _decoded(safetensors.torch.load(content), record.get("encodings", {}))
        return make(StoredModel(tensors, record, encodings))
    except (ValueError, KeyError, TypeError, OSError) as error:
        reason = f"lacks {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{path} can't be read: {reason}") from error


def _decoded(stored: Mapping[str, Tensor], forms: Mapping[str, str]) -> tuple[dict[str, Tensor], dict[str, Encoding]]:
    """The tensors of a file in float32, and the encodings of those that `forms` names."""
    parts: dict[str, dict[str, Tensor]] = {name: {} for name in forms}
    tensors = {}
    for key, tensor in stored.items():
        name, separator, part = key.partition(SEPARATOR)
        if separator:
            parts[name][part] = tensor
        else:
            tensors[name] = tensor
    encodings = {name: Encoding.of_tensors(form, parts[name]) for name, form in forms.items()}
    return tensors | {name: encoding.decoded() for name, encoding in encodings.items()}, encodings
