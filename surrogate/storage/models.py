"""A trained model on disk: `model.safetensors` holds its tensors, `model.json` all else."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import safetensors.torch
import torch
from torch import Tensor

from catalogs.files import durable
from catalogs.vocabulary.words import one_line
from surrogate.storage.checkpoints import CHECKPOINT
from surrogate.storage.encoding import Encoding
from surrogate.storage.files import opened_inside
from surrogate.storage.tensors import MOST_BYTES, read_tensors, tensors_of

SCHEMA = 6
TENSORS, RECORD = "model.safetensors", "model.json"
MOST_RECORD_BYTES = 16_000_000  # one of a hundred transfer functions has some 100 kB
SEPARATOR = "/"  # between the name of an encoded tensor and that of its part

Model = TypeVar("Model")


@dataclass(frozen=True, eq=False)
class StoredModel:
    """The contents of a model's files.

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
        durable.make_folder(directory)
        content, record = self.contents()
        durable.replace(directory / TENSORS, content)
        durable.replace(directory / RECORD, record)

    def contents(self) -> tuple[bytes, bytes]:
        """The bytes of the two files: the tensors, and the record."""
        content, record = self._files()
        return content, json.dumps(record, indent=1).encode()

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
        tensors, forms = dict[str, Tensor](), dict[str, str]()
        for name, tensor in self.tensors.items():
            encoding = self.encodings.get(name)
            if encoding is not None and torch.equal(encoding.decoded(), tensor.cpu()):
                tensors |= {f"{name}{SEPARATOR}{part}": t for part, t in encoding.tensors().items()}
                forms[name] = encoding.form
            else:
                tensors[name] = tensor
        return tensors, forms


def exists(directory: str | os.PathLike[str]) -> bool:
    """True where `directory` holds a whole model."""
    return (Path(directory) / RECORD).is_file()


def remove(directory: str | os.PathLike[str]) -> None:
    """Delete the model in `directory`, if there is one, and nothing else."""
    for name in (RECORD, TENSORS):
        (Path(directory) / name).unlink(missing_ok=True)


def load(directory: str | os.PathLike[str], make: Callable[[StoredModel], Model]) -> Model:
    """The model in `directory`, made by `make`.

    The files may come from anyone: nothing in them is run, nothing outside the folder is read, and no more memory is taken than the
    tensors need.  Raises FileNotFoundError where there is no model, ValueError for one of a newer schema and, naming the part, for
    one that is damaged.
    """
    directory = Path(directory)
    record = read_record(directory)
    with damaged(str(directory / RECORD)):
        with part("tensors"):
            if not isinstance(record["tensors"], dict) or record["tensors"].get("file") != TENSORS:
                raise ValueError(f"file must be {TENSORS!r}, which lies beside it, got {record['tensors']!r}")
        with part(TENSORS), opened_inside(directory, TENSORS, MOST_BYTES) as (file, size):
            content = read_tensors(file, size)
        return _model_of(content, record, make)


def read_record(directory: str | os.PathLike[str]) -> dict[str, Any]:
    """The record of the model in `directory`, without its tensors; raises as `load` does."""
    path = Path(directory) / RECORD
    if not path.is_file():
        raise FileNotFoundError(_absence(Path(directory)))
    with (
        damaged(str(path)),
        part("the file"),
        opened_inside(Path(directory), RECORD, MOST_RECORD_BYTES) as (file, size),
    ):
        return _record(file.read(size))


def _absence(directory: Path) -> str:
    """The sentence that says why there is no model in `directory`, and what makes it."""
    run = directory.parent
    if (run / "run.json").is_file() or (directory / CHECKPOINT).is_file():
        return f"the training in {run} has not ended yet: `surrogate train {run}` resumes it where it was interrupted"
    return f"there is no trained surrogate in {directory}: `surrogate train` makes one"


def of_contents(content: bytes, record: bytes, make: Callable[[StoredModel], Model]) -> Model:
    """The model of some `contents()`, made by `make`; raises ValueError as `load` does."""
    with damaged("a surrogate in bytes"):
        with part("the record"):
            values = _record(record)
        return _model_of(content, values, make)


class _DamageError(ValueError):
    """Which part of a model is wrong, and how."""


@contextmanager
def damaged(what: str) -> Iterator[None]:
    """Say of damage in the block that it is that of `what`."""
    try:
        yield
    except _DamageError as error:
        raise ValueError(f"{what} is damaged: {error}") from error
    except _NewerError as error:
        raise ValueError(f"{what} can't be read: {error}") from error


@contextmanager
def part(name: str) -> Iterator[None]:
    """Say of whatever goes wrong in the block that it is the damage of a model's part `name`."""
    try:
        yield
    except (_DamageError, _NewerError):
        raise
    except KeyError as error:
        raise _DamageError(f"{name}: {error} is missing") from error
    except (ValueError, TypeError, AttributeError, LookupError, ArithmeticError, RuntimeError, OSError) as error:
        raise _DamageError(f"{name}: {' '.join(str(error).split())}") from error


class _NewerError(ValueError):
    """A schema that this version does not know."""


def _record(text: bytes) -> dict[str, Any]:
    """The JSON object of a record whose schema this version knows."""
    try:
        record = json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    if not isinstance(record, dict):
        raise ValueError("it is not a JSON object")
    schema = record["schema"]
    if type(schema) is not int or schema < 1:
        raise ValueError(f"schema must be a whole number from 1 on, got {schema!r}")
    if schema > SCHEMA:
        raise _NewerError(f"its schema is {schema}, this version reads up to {SCHEMA}: update it")
    return record


def _model_of(content: bytes, record: Mapping[str, Any], make: Callable[[StoredModel], Model]) -> Model:
    with part(TENSORS):
        if hashlib.sha256(content).hexdigest() != record["tensors"].get("sha256"):
            raise ValueError("it does not belong to the record, or is not whole: copy both again, or train anew")
        encoded = tensors_of(content)
    with part("encodings"):
        forms = record["encodings"]
        if not isinstance(forms, dict):
            raise ValueError(f"they must be formats by the names of tensors, got {forms!r}")
        tensors, encodings = _decoded(encoded, forms)
    for name, tensor in tensors.items():
        with part(f"tensor {name!r}"):
            if tensor.dtype != torch.float32:
                raise ValueError(f"it must be of type float32, got {tensor.dtype}")
            if not torch.isfinite(tensor).all():
                raise ValueError("it has numbers that are not finite")
    with part("the model"):
        return make(StoredModel(tensors, record, encodings))


def _decoded(encoded: Mapping[str, Tensor], forms: Mapping[str, str]) -> tuple[dict[str, Tensor], dict[str, Encoding]]:
    """The tensors of a file in float32, and the encodings of those that `forms` names."""
    parts: dict[str, dict[str, Tensor]] = {name: {} for name in forms}
    tensors = {}
    for key, tensor in encoded.items():
        name, separator, of = key.partition(SEPARATOR)
        if separator:
            parts[name][of] = tensor
        else:
            tensors[name] = tensor
    encodings = {name: Encoding.of_tensors(form, parts[name]) for name, form in forms.items()}
    return tensors | {name: encoding.decoded() for name, encoding in encodings.items()}, encodings
