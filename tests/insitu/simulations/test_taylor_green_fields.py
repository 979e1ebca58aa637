"""The fields and dumps that scenes ask of the Taylor-Green vortex, against the solver and its plain twin."""

from __future__ import annotations

import numpy as np
import pytest

from insitu.simulations import Field, simulation
from insitu.simulations.runge_kutta import FlowState
from insitu.simulations.taylor_green import TaylorGreen
from insitu.simulations.taylor_green_fields import SIMULATION, dumps, run, run_fields
from tests.support.periodic_box import PeriodicBox


def test_run_returns_a_field_to_render():
    fractions: list[float] = []
    field = simulation("taylor_green").run({"Re": 1800.0}, resolution=16, time=1.5, progress=fractions.append)
    flow = TaylorGreen(resolution=16, reynolds=1800.0)
    assert isinstance(field, Field)
    assert field.values.shape == (16, 16, 16)
    assert field.values.dtype == np.float32
    assert field.values.flags.c_contiguous
    assert (field.spacing, field.origin, field.name, field.unit, field.time) == (
        (np.pi / 8,) * 3,
        (0.0,) * 3,
        "Q",
        "",
        1.5,
    )
    assert np.array_equal(field.values, flow.q_criterion(flow.advance(flow.initial(), until=1.5)))
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert "Q on 16 x 16 x 16 points" in repr(field)


def test_run_at_time_zero_is_the_initial_condition():
    assert run({"Re": 100.0}, resolution=8, time=0.0).time == 0.0


def test_a_field_can_be_solved_on_more_points_than_it_has():
    fine = TaylorGreen(resolution=32, reynolds=400.0)
    state = fine.advance(fine.initial(), until=3.0)
    modes = np.fft.rfftn(fine.velocity(state).astype(np.float64), axes=(1, 2, 3), norm="forward")
    index = np.fft.ifftshift(np.arange(-8, 8))  # the modes that 16 points tell apart; those from 16 / 3 on are cut
    coarse = modes[:, index[:, None, None], index[:, None], np.arange(9)]
    for axis, k in ((1, index), (2, index), (3, np.arange(9))):
        np.moveaxis(coarse, axis, 0)[3 * np.abs(k) >= 16] = 0.0
    velocity = np.fft.irfftn(coarse, (16, 16, 16), axes=(1, 2, 3), norm="forward")
    box = PeriodicBox(16, fine.viscosity, dtype="float64")
    expected = box.q_criterion(box.initial(velocity))

    field = run({"Re": 400.0}, resolution=16, time=3.0, solver_resolution=32)
    assert field.spacing == (np.pi / 8,) * 3
    assert np.abs(field.values - expected).max() < 1e-5 * np.abs(expected).max()
    unresolved = run({"Re": 400.0}, resolution=16, time=3.0).values
    assert np.abs(unresolved - expected).max() > 0.01 * np.abs(expected).max(), "this flow needs more than 16 points"


def test_a_field_has_no_more_points_than_its_solver():
    with pytest.raises(ValueError, match="at least the field's 32, got 16"):
        run({"Re": 400.0}, resolution=32, time=1.0, solver_resolution=16)
    flow = TaylorGreen(resolution=16)
    with pytest.raises(ValueError, match="16 points cannot be coarsened to 32"):
        flow.coarsened(flow.initial(), 32)


@pytest.mark.parametrize("parameters", [{}, {"Re": 1.0, "Ma": 0.1}, {"reynolds": 1600.0}])
def test_run_names_its_one_parameter(parameters: dict[str, float]):
    with pytest.raises(ValueError, match="one parameter Re"):
        run(parameters, resolution=8, time=1.0)


def test_the_first_field_is_what_run_returns():
    every = run_fields({"Re": 400.0}, fields=SIMULATION.fields, resolution=16, time=1.0)
    assert list(every) == list(SIMULATION.fields) == ["q_criterion", "speed", "vorticity"]
    assert np.array_equal(every["q_criterion"].values, run({"Re": 400.0}, resolution=16, time=1.0).values)
    assert [field.name for field in every.values()] == ["Q", "|u|", "|∇ x u|"]
    for field in every.values():
        assert (field.values.shape, field.values.dtype, field.time) == ((16, 16, 16), np.float32, 1.0)


def test_speed_and_vorticity_of_the_initial_vortex_are_known():
    # u = sin x cos y cos z, v = -cos x sin y cos z; ∇ x u = (-cos x sin y sin z, -sin x cos y sin z, 2 sin x sin y cos z)
    found = run_fields({"Re": 100.0}, fields=("vorticity", "speed"), resolution=16, time=0.0)
    z, y, x = np.meshgrid(*[2 * np.pi * np.arange(16) / 16] * 3, indexing="ij")
    speed = np.abs(np.cos(z)) * np.hypot(np.sin(x) * np.cos(y), np.cos(x) * np.sin(y))
    curl = [
        -np.cos(x) * np.sin(y) * np.sin(z),
        -np.sin(x) * np.cos(y) * np.sin(z),
        2 * np.sin(x) * np.sin(y) * np.cos(z),
    ]
    assert np.abs(found["speed"].values - speed).max() < 1e-6
    assert np.abs(found["vorticity"].values - np.linalg.norm(curl, axis=0)).max() < 2e-6


def test_speed_and_vorticity_later_are_those_of_the_plain_solver():
    found = run_fields({"Re": 50.0}, fields=("speed", "vorticity"), resolution=16, time=1.0)
    box = PeriodicBox(16, 1 / 50.0, dtype="float64")
    z, y, x = np.meshgrid(*[2 * np.pi * np.arange(16) / 16] * 3, indexing="ij")
    start = np.stack([np.sin(x) * np.cos(y) * np.cos(z), -np.cos(x) * np.sin(y) * np.cos(z), np.zeros_like(x)])
    state = box.advance(box.initial(start), until=1.0)
    for name, vector in (("speed", box.velocity(state)), ("vorticity", box.vorticity(state))):
        assert np.abs(found[name].values - np.linalg.norm(vector, axis=0)).max() < 1e-4


@pytest.mark.parametrize("fields", [(), ("pressure",), ("speed", "speed"), ("speed", "Q")])
def test_unknown_fields_are_named(fields: tuple[str, ...]):
    with pytest.raises(ValueError, match=r"some of q_criterion, speed, vorticity, each once"):
        run_fields({"Re": 50.0}, fields=fields, resolution=16, time=1.0)


# --- several dumps of one run -----------------------------------------------------------------------------------------


def test_a_dump_is_the_flow_at_its_time_and_does_not_depend_on_the_others():
    fractions: list[float] = []
    times = [0.0, 0.7, 0.71, 2.0, 2.5]
    how = {"fields": ("q_criterion", "speed"), "resolution": 16, "solver_resolution": 20}
    found = list(dumps({"Re": 400.0}, times=times, progress=fractions.append, **how))
    for time, fields in zip(times, found, strict=True):
        (alone,) = dumps({"Re": 400.0}, times=[time], **how)
        apart = run_fields({"Re": 400.0}, time=time, **how)
        for name, field in fields.items():
            assert field.time == time
            assert np.array_equal(field.values, alone[name].values), "to the last bit"
            assert np.abs(field.values - apart[name].values).max() < 1e-4 * np.abs(field.values).max()
    assert all(0.0 <= fraction <= 1.0 for fraction in fractions)
    assert fractions[-1] == 1.0


def test_dumps_are_of_one_run(monkeypatch: pytest.MonkeyPatch):
    started: list[FlowState] = []
    initial = TaylorGreen.initial
    monkeypatch.setattr(TaylorGreen, "initial", lambda flow: started.append(initial(flow)) or started[-1])
    coming = dumps({"Re": 400.0}, fields=("q_criterion",), resolution=8, times=[0.5, 1.0, 1.5])
    assert [fields["q_criterion"].time for fields in coming] == [0.5, 1.0, 1.5]
    assert len(started) == 1


@pytest.mark.parametrize("times", [[-1.0, 1.0], [1.0, 1.0], [2.0, 1.0], [float("nan")], [float("inf")]])
def test_times_of_dumps_ascend(times: list[float]):
    with pytest.raises(ValueError, match="must ascend from 0 on"):
        dumps({"Re": 400.0}, fields=("q_criterion",), resolution=8, times=times)
