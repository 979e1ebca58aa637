"""The symmetric solver against its plain twin, exact laws, and a direct numerical simulation of 512³ points."""

from __future__ import annotations

import doctest
import itertools
import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import insitu.simulations.taylor_green as module
from insitu.simulations import Field, simulation
from insitu.simulations.periodic_box import PeriodicBox
from insitu.simulations.runge_kutta import State
from insitu.simulations.taylor_green import SIMULATION, TaylorGreen, run, run_fields

REFERENCE = "TGV_Re1600_incompact3d_512.dat"


def advanced(flow: TaylorGreen, until: float) -> State:
    return flow.advance(flow.initial(), until=until)


@cache
def history(resolution: int, until: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, kinetic energies and dissipations of the float32 flow at Re 1600."""
    flow = TaylorGreen(resolution=resolution)
    start = flow.initial()
    rows = [
        (s.time, flow.kinetic_energy(s), flow.dissipation(s))
        for s in itertools.chain([start], flow.steps(start, until))
    ]
    return tuple(np.array(rows).T)


# --- against the plain twin ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("resolution", [8, 12, 16, 20, 28])  # the highest kept wavenumber is even and odd among them
def test_the_flow_is_that_of_the_plain_twin(resolution: int):
    flow = TaylorGreen(resolution=resolution, reynolds=50.0, dtype="float64", cfl=0.05)
    box = PeriodicBox(resolution, flow.viscosity, dtype="float64", cfl=0.05)
    state = advanced(flow, 2.0)
    twin = box.advance(box.initial(flow.velocity(flow.initial())), until=2.0)
    assert np.abs(flow.velocity(state) - box.velocity(twin)).max() < 1e-9
    assert np.abs(flow.velocity(state)[2]).max() > 0.01, "the flow must have become three-dimensional"


@pytest.mark.parametrize("resolution", [12, 20])
def test_every_quantity_is_that_of_the_plain_twin(resolution: int):
    flow = TaylorGreen(resolution=resolution, reynolds=400.0, dtype="float64")
    state = advanced(flow, 4.0)
    box = PeriodicBox(resolution, flow.viscosity, dtype="float64")
    twin = box.initial(flow.velocity(state))
    assert np.abs(box.velocity(twin) - flow.velocity(state)).max() < 1e-13, "free of divergence, and nothing cut"
    assert np.abs(flow.vorticity(state) - box.vorticity(twin)).max() < 1e-11
    assert np.abs(flow.q_criterion(state) - box.q_criterion(twin)).max() < 1e-11
    for quantity in ("kinetic_energy", "enstrophy", "dissipation"):
        assert getattr(flow, quantity)(state) == pytest.approx(getattr(box, quantity)(twin), rel=1e-12), quantity


# --- exact laws ------------------------------------------------------------------------------------------------------


def test_the_initial_condition_and_its_q():
    flow = TaylorGreen(resolution=16, dtype="float64")
    points = flow.origin[0] + flow.spacing[0] * np.arange(16)
    z, y, x = np.meshgrid(points, points, points, indexing="ij", sparse=True)
    velocity = [np.sin(x) * np.cos(y) * np.cos(z), -np.cos(x) * np.sin(y) * np.cos(z), np.zeros((16, 16, 16))]
    q = np.cos(z) ** 2 * (np.sin(x) ** 2 * np.sin(y) ** 2 - np.cos(x) ** 2 * np.cos(y) ** 2)
    assert np.abs(flow.velocity(flow.initial()) - np.stack(velocity)).max() < 1e-14
    assert np.abs(flow.q_criterion(flow.initial()) - q).max() < 1e-14
    assert flow.kinetic_energy(flow.initial()) == pytest.approx(0.125, rel=1e-14)
    assert flow.enstrophy(flow.initial()) == pytest.approx(0.375, rel=1e-14)


def test_without_viscosity_energy_is_conserved_to_the_order_of_the_step():
    errors = []
    for cfl in (1.2, 0.6, 0.3):
        flow = TaylorGreen(resolution=32, reynolds=np.inf, dtype="float64", cfl=cfl)
        errors.append(abs(flow.kinetic_energy(advanced(flow, 5.0)) / 0.125 - 1.0))
    assert errors[-1] < 1e-7
    orders = [np.log2(coarse / fine) for coarse, fine in itertools.pairwise(errors)]
    assert orders == pytest.approx([4.0, 4.0], abs=0.4), f"energy errors {errors}"


def test_energy_falls_at_the_rate_of_dissipation():
    flow = TaylorGreen(resolution=32, dtype="float64")
    start = advanced(flow, 4.0)
    before, middle, after = (flow.advance(start, until=4.0 + moment) for moment in (0.0, 0.01, 0.02))
    rate = (flow.kinetic_energy(after) - flow.kinetic_energy(before)) / 0.02
    assert -rate == pytest.approx(flow.dissipation(middle), rel=1e-5)


def test_single_precision_follows_double():
    single, double = TaylorGreen(resolution=32), TaylorGreen(resolution=32, dtype="float64")
    rough, fine = advanced(single, 5.0), advanced(double, 5.0)
    assert rough.modes.dtype == single.q_criterion(rough).dtype == single.velocity(rough).dtype == np.float32
    q = double.q_criterion(fine)
    assert np.abs(single.q_criterion(rough) - q).max() < 3e-5 * np.abs(q).max()
    assert single.kinetic_energy(rough) == pytest.approx(double.kinetic_energy(fine), rel=1e-5)


def test_modes_do_not_depend_on_how_often_the_loop_stops():
    flow = TaylorGreen(resolution=16, dtype="float64", cfl=0.1)
    state = flow.initial()
    for stop in (0.3, 0.7, 1.0):
        state = flow.advance(state, until=stop)
        assert state.time == stop
    assert np.abs(flow.velocity(state) - flow.velocity(advanced(flow, 1.0))).max() < 1e-8


# --- against the direct numerical simulation -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("resolution", "until", "energy_error", "dissipation_error"),
    [  # measured: docs/taylor_green.md; the dissipation error is relative to the reference's peak
        (32, 3.0, 2e-4, 0.003),
        (64, 4.01, 5e-4, 0.005),
        (64, 9.01, 0.05, 0.16),
    ],
)
def test_energy_and_dissipation_are_those_of_the_reference(
    shared_data: Path, resolution: int, until: float, energy_error: float, dissipation_error: float
):
    reference = np.loadtxt(shared_data / REFERENCE)
    times, energies, dissipations = history(resolution, 9.01)
    rows = reference[reference[:, 0] <= until]
    energy = np.interp(rows[:, 0], times, energies)
    dissipation = np.interp(rows[:, 0], times, dissipations)
    assert np.abs(energy / rows[:, 1] - 1.0).max() < energy_error
    assert np.abs(dissipation - rows[:, 3]).max() / reference[:, 3].max() < dissipation_error


@pytest.mark.slow
def test_the_reference_is_approached_with_resolution(shared_data: Path):
    reference = np.loadtxt(shared_data / REFERENCE)
    rows = reference[reference[:, 0] <= 9.0]
    errors = []
    for resolution in (32, 64, 128, 192):
        times, energies, _ = history(resolution, 9.0)
        errors.append(np.abs(np.interp(rows[:, 0], times, energies) / rows[:, 1] - 1.0).max())
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.01, f"largest relative energy errors up to t = 9: {errors}"


# --- as a simulation of a scene --------------------------------------------------------------------------------------


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
    assert np.array_equal(field.values, flow.q_criterion(advanced(flow, 1.5)))
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert "Q on 16 x 16 x 16 points" in repr(field)


def test_run_at_time_zero_is_the_initial_condition():
    assert run({"Re": 100.0}, resolution=8, time=0.0).time == 0.0


def test_a_field_can_be_solved_on_more_points_than_it_has():
    fine = TaylorGreen(resolution=32, reynolds=400.0)
    state = advanced(fine, 3.0)
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


def test_the_solver_travels_to_another_process():
    flow = TaylorGreen(resolution=8)
    state = advanced(flow, 0.5)
    again, there = pickle.loads(pickle.dumps((flow, state)))
    assert again == flow
    assert np.array_equal(again.q_criterion(there), flow.q_criterion(state))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"resolution": 30}, "multiple of 4 and at least 8, got 30"),
        ({"resolution": 4}, "got 4"),
        ({"resolution": 64.0}, "got 64.0"),
        ({"reynolds": 0.0}, "must be positive, got 0.0"),
        ({"reynolds": float("nan")}, "must be positive, got nan"),
        ({"cfl": 2.0}, r"cfl must lie in \(0, 1.35\]"),
        ({"dtype": "float16"}, "got 'float16'"),
    ],
)
def test_what_cannot_be_solved_is_refused(arguments: dict, message: str):
    with pytest.raises(ValueError, match=message):
        replace(TaylorGreen(), **arguments)


def test_a_flow_that_is_not_finite_is_named():
    flow = TaylorGreen(resolution=8)
    broken = State(0.5, np.full_like(flow.initial().modes, np.nan))
    with pytest.raises(FloatingPointError, match=r"t = 0\.5"):
        flow.advance(broken, until=1.0)


def test_the_docstrings_tell_the_truth():
    assert doctest.testmod(module).failed == 0


# --- the fields that a scene may name ---------------------------------------------------------------------------------


def test_the_first_field_is_what_run_returns():
    every = run_fields({"Re": 400.0}, fields=SIMULATION.fields, resolution=16, time=1.0)
    assert list(every) == list(SIMULATION.fields) == ["q_criterion", "speed", "vorticity"]
    assert np.array_equal(every["q_criterion"].values, run({"Re": 400.0}, resolution=16, time=1.0).values)
    assert [field.name for field in every.values()] == ["Q", "|u|", "|∇ x u|"]
    for field in every.values():
        assert (field.values.shape, field.values.dtype, field.time) == ((16, 16, 16), np.float32, 1.0)


def test_speed_and_vorticity_of_the_initial_vortex_are_known():
    """u = sin x cos y cos z, v = -cos x sin y cos z; ∇ x u = (-cos x sin y sin z, -sin x cos y sin z, 2 sin x sin y cos z)."""
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
    with pytest.raises(ValueError, match=r"some of \['q_criterion', 'speed', 'vorticity'\], each once"):
        run_fields({"Re": 50.0}, fields=fields, resolution=16, time=1.0)
