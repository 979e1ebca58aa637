from pathlib import Path

import pytest
import torch

from surrogate.checkpoints import CHECKPOINT, Checkpoint, fingerprint, locked
from surrogate.settings import TrainingSettings


def test_a_checkpoint_survives_bit_for_bit(tmp_path: Path) -> None:
    tensors = {"a": torch.randn(7, 3), "b": torch.tensor([float("inf"), -0.0, 1e-45])}
    record = {"step": 12, "losses": [0.1 + 0.2, 1e-300], "stage": "canonical", "nothing": None}
    Checkpoint(tensors, record).save(tmp_path)
    loaded = Checkpoint.load(tmp_path)
    assert loaded is not None
    assert loaded.record == record
    assert all(loaded.tensors[name].numpy().tobytes() == tensor.numpy().tobytes() for name, tensor in tensors.items())
    assert [path.name for path in tmp_path.iterdir()] == [CHECKPOINT]


def test_no_checkpoint_is_none(tmp_path: Path) -> None:
    assert Checkpoint.load(tmp_path) is None


@pytest.mark.parametrize("content", [b"", b"half a file", b"\x02\x00\x00\x00\x00\x00\x00\x00{}"])
def test_what_is_no_checkpoint_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / CHECKPOINT).write_bytes(content)
    with pytest.raises(ValueError, match=r"checkpoint\.safetensors is not a checkpoint .*delete it to train anew"):
        Checkpoint.load(tmp_path)


def test_a_folder_is_held_by_one(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(RuntimeError, match="another process is training"), locked(tmp_path):
        pass
    with locked(tmp_path):
        pass


def test_the_fingerprint_sees_every_setting_and_member_but_not_the_clock(make_catalog) -> None:
    catalog = make_catalog()
    mark = fingerprint(TrainingSettings(), catalog)
    assert fingerprint(TrainingSettings(checkpoint_seconds=1.0), catalog) == mark
    others = {
        "setting": fingerprint(TrainingSettings(mean_rate=1e-5), catalog),
        "split": fingerprint(
            TrainingSettings(), make_catalog(members=(("train", 0.0), ("train", 0.5), ("test", 1.0)), name="a.cdb")
        ),
        "member": fingerprint(TrainingSettings(), make_catalog(members=(("train", 0.0), ("train", 0.5)), name="b.cdb")),
        "image": fingerprint(TrainingSettings(), make_catalog(blank=True, name="c.cdb")),
        "background": fingerprint(TrainingSettings(), make_catalog(background=(0.0, 0.0, 0.0), name="d.cdb")),
    }
    assert len({mark, *others.values()}) == 6
    assert fingerprint(TrainingSettings(), make_catalog(name="same.cdb")) == mark
