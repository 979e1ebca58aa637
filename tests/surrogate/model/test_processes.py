"""A surrogate in other processes: forked ones, those it is sent to, and those that start anew."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from surrogate import Surrogate
from surrogate.notebook import first_camera
from tests.support.comparing import same
from tests.support.surrogates import large_surrogate, some_surrogate
from tests.support.visualizations import base, of_functions, of_isovalue, surrogate

FORKS = "fork" in multiprocessing.get_all_start_methods()


def drawn(model: Surrogate, fraction: float) -> np.ndarray:
    camera = first_camera(model.normalization, 8)
    return model.at({p.name: p.at(fraction) for p in model.space.parameters}).render(camera)


@pytest.mark.slow
@pytest.mark.skipif(not FORKS, reason="no fork on this system")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_forked_processes_draw_what_was_loaded_before(tmp_path: Path) -> None:
    """In a process of its own, whose OpenMP has started threads: where it hangs, only that one is killed."""
    large_surrogate().save(tmp_path)
    program = (
        "import multiprocessing, sys, torch\n"
        "from surrogate import Surrogate\n"
        "from tests.surrogate.model.test_processes import drawn\n"
        "torch.set_num_threads(2)\n"
        f"model = Surrogate.load({str(tmp_path)!r})\n"
        "expected = [drawn(model, 0.1 * k) for k in range(4)]\n"
        "from functools import partial\n"
        "with multiprocessing.get_context('fork').Pool(2) as pool:\n"
        "    found = pool.map_async(partial(drawn, model), [0.1 * k for k in range(4)]).get(timeout=60)\n"
        "assert all((a == b).all() for a, b in zip(expected, found)), 'another picture'\n"
        "print(torch.get_num_threads())\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["2"]  # the parent keeps its threads


def varied() -> Surrogate:
    fitted = base()
    return surrogate(fitted, of_isovalue(fitted, 1), of_functions(fitted))


MODELS = [
    pytest.param(some_surrogate, id="one colour"),
    pytest.param(partial(some_surrogate, 12), id="colours by direction"),
    pytest.param(varied, id="varied"),
]


@pytest.mark.parametrize("make", MODELS)
@pytest.mark.parametrize("send", [lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy, copy.copy])
def test_what_was_pickled_or_copied_is_the_same_bit_for_bit(make: object, send: object, tmp_path: Path) -> None:
    make().save(tmp_path)  # type: ignore[operator]
    for model in (make(), Surrogate.load(tmp_path)):  # type: ignore[operator]
        again = send(model)  # type: ignore[operator]
        assert again.digest == model.digest
        assert same(again.gaussians, model.gaussians)
        assert (again.background, again.rasterizer, again.space) == (model.background, model.rasterizer, model.space)
        np.testing.assert_array_equal(drawn(again, 0.4), drawn(model, 0.4))


def test_the_gaussians_of_one_member_can_be_pickled() -> None:
    deformed = some_surrogate().at(Re=1600.0, time=1.0)
    again, camera = pickle.loads(pickle.dumps(deformed)), first_camera(deformed.normalization, 8)
    np.testing.assert_array_equal(again.render(camera), deformed.render(camera))


def test_damaged_bytes_are_refused() -> None:
    make, (tensors, record, device) = some_surrogate().__reduce__()
    for wrong in ((tensors[:-1], record), (tensors, record[:-1]), (tensors, b"[]"), (tensors[8:], record)):
        with pytest.raises(ValueError, match="a surrogate in bytes is damaged: "):
            make(*wrong, device)


@pytest.mark.slow
def test_another_start_method_draws_the_same() -> None:
    model = some_surrogate()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.apply_async(drawn, (model, 0.2)).get(timeout=100)
    np.testing.assert_array_equal(found, drawn(model, 0.2))


def test_loaded_tensors_begin_where_processors_like_it(tmp_path: Path) -> None:
    some_surrogate(12).save(tmp_path)
    model = Surrogate.load(tmp_path)
    tensors = {**model.gaussians.tensors(), **model.deformation.tensors()}
    assert {name: t.data_ptr() % 64 for name, t in tensors.items()} == dict.fromkeys(tensors, 0)
