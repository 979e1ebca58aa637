"""Measure the Taylor-Green solver and write docs/results/taylor_green.md and docs/results/taylor_green.png.

    OMP_NUM_THREADS=1 python -m research.benchmarks.simulation.taylor_green [--finest] [--parts scene steps]
    [--machine "two shared cores"]

Accuracy does not depend on the machine; times do. Takes about eight minutes on one core, most of them for the runs at
256³, and 2 GB.
"""

from __future__ import annotations

import os
import sys
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from insitu.simulations.runge_kutta import FlowState
from insitu.simulations.taylor_green import TaylorGreen
from research.benchmarks.page import PROJECT, RESULTS, command_line, made_by, stopwatch, table, titled, write_parts
from research.benchmarks.splatting.figures import panels
from research.benchmarks.timing import processor_seconds
from tests.support.periodic_box import PeriodicBox

PAGE, FIGURE = RESULTS / "taylor_green.md", RESULTS / "taylor_green.png"
REFERENCE = "TGV_Re1600_incompact3d_512.dat"
RESOLUTIONS = (32, 64, 128, 256)
Q_TIMES = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0)


@dataclass(frozen=True)
class History:
    """A run from t = 0 to 10: a row per step, Q (z, y, x) at `Q_TIMES`, and seconds of processor time.

    `q` holds samples on at most 128³ of the run's points, `coarsened` Q of the velocity's modes that 64³ points keep.
    """

    times: NDArray[np.float64]
    energy: NDArray[np.float64]
    dissipation: NDArray[np.float64]
    q: dict[float, NDArray[np.float32]]
    coarsened: dict[float, NDArray[np.float32]]
    seconds: float


@cache
def history(resolution: int, reynolds: float, until: float = 10.0) -> History:
    flow = TaylorGreen(resolution=resolution, reynolds=reynolds)
    state = flow.initial()
    rows, q, seconds = [(0.0, flow.kinetic_energy(state), flow.dissipation(state))], {}, 0.0
    coarsened = {}
    for stop in sorted({*(t for t in Q_TIMES if t <= until), until}):
        start = clock.process_time()
        for state in flow.steps(state, stop):  # noqa: B020 - goes on from the last state
            rows.append((state.time, flow.kinetic_energy(state), flow.dissipation(state)))
        seconds += clock.process_time() - start
        if stop in Q_TIMES:
            step = max(1, resolution // 128)
            q[stop] = flow.q_criterion(state)[::step, ::step, ::step].copy()
            coarse, modes = flow.coarsened(state, min(resolution, 64))
            coarsened[stop] = coarse.q_criterion(modes)
    times, energy, dissipation = np.array(rows).T
    return History(times, energy, dissipation, q, coarsened, seconds)


def against_reference(reference: NDArray[np.float64], resolutions: Sequence[int]) -> str:
    """Deviations up to t = 10 at Re 1600; columns of the reference: t, E, -dE/dt, dissipation."""
    rows_of_reference = reference[reference[:, 0] <= 10.0]
    time, energy, dissipation = rows_of_reference[:, 0], rows_of_reference[:, 1], rows_of_reference[:, 3]
    peak = dissipation.max()
    rows = []
    for n in resolutions:
        run = history(n, 1600.0)
        energy_error = np.interp(time, run.times, run.energy) / energy - 1.0
        dissipation_error = (np.interp(time, run.times, run.dissipation) - dissipation) / peak
        early = time <= 5.0
        top = int(run.dissipation.argmax())
        rows.append(
            [
                f"{n}³",
                f"{100 * np.abs(energy_error[early]).max():.3f} %",
                f"{100 * np.abs(dissipation_error[early]).max():.2f} %",
                f"{100 * np.abs(energy_error).max():.2f} %",
                f"{100 * np.abs(dissipation_error).max():.1f} %",
                f"{run.dissipation[top]:.6f} at t = {run.times[top]:.2f}",
                f"{np.interp(9.0, run.times, run.energy):.5f}",
            ]
        )
    rows.append(["reference, 512³", "", "", "", "", "0.012857 at t = 8.98", "0.08640"])
    header = ["points", "energy, t ≤ 5", "dissipation, t ≤ 5", "energy, t ≤ 10", "dissipation, t ≤ 10", "peak", "E(9)"]
    return table(header, rows)


def difference(coarse: NDArray[np.float32], fine: NDArray[np.float32]) -> tuple[float, float]:
    """Relative L2 norm of the difference, and its maximum over max |Q|, on the coarse run's points."""
    step = fine.shape[0] // coarse.shape[0]
    truth = fine[::step, ::step, ::step].astype(np.float64)
    error = coarse - truth
    return float(np.linalg.norm(error) / np.linalg.norm(truth)), float(np.abs(error).max() / np.abs(truth).max())


def pointwise() -> str:
    cases = [(n, re, t) for n in (64,) for t in (5.0, 8.0) for re in (1500.0, 1600.0, 2500.0)]
    cases += [(128, re, t) for t in (5.0, 8.0) for re in (1600.0, 2500.0)]
    rows = []
    for n, reynolds, t in cases:
        coarse, fine = history(n, reynolds), history(2 * n, reynolds)
        l2, largest = difference(coarse.q[t], fine.q[t])
        q = fine.q[t]
        rows.append(
            [
                f"{n}³ against {2 * n}³",
                f"{reynolds:g}",
                f"{t:g}",
                f"{l2:.3f}",
                f"{largest:.3f}",
                f"{q.min():.1f} to {q.max():.1f}",
            ]
        )
    header = ["points", "Re", "t", "relative L2", "max difference / max abs(Q)", "range of Q (finer run)"]
    return table(header, rows)


def coarsened() -> str:
    """Q on 64³ points of the flow solved on n³ (`run(..., resolution=64, solver_resolution=n)`), against n = 256."""
    rows = []
    for reynolds in (1600.0, 2500.0):
        for t in (3.0, 4.0, 5.0, 6.0, 7.0, 8.0):
            truth = history(256, reynolds).coarsened[t]
            cells = [f"{reynolds:g}", f"{t:g}", f"{truth.min():.1f} to {truth.max():.1f}"]
            for n in (64, 96, 128, 192):
                l2, largest = difference(history(n, reynolds).coarsened[t], truth)
                cells.append(f"{l2:.3f} / {largest:.3f}")
            rows.append(cells)
    return table(["Re", "t", "range of Q", "solved on 64³", "96³", "128³", "192³"], rows)


def scene() -> str:
    """Q as the scene `tgv` has it, on 64³ points, by the resolution of the solver, against 256³."""
    rows = []
    for reynolds in (200.0, 400.0, 800.0, 1600.0):
        for t in (2.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0):
            truth = history(256, reynolds).coarsened[t]
            errors = [difference(history(n, reynolds).coarsened[t], truth)[0] for n in (64, 128, 192)]
            rows.append(
                [f"{reynolds:g}", f"{t:g}", f"{truth.min():.1f} to {truth.max():.1f}", *(f"{e:.3f}" for e in errors)]
            )
    return table(["Re", "t", "range of Q", "solved on 64³", "128³", "192³"], rows)


def finest() -> str:
    """Difference of the finest runs above from 384³, at the hardest Re: Q on m³ points solved on n³."""
    rows = []
    for m in (64, 128):
        for t in (5.0, 6.0, 7.0, 8.0):
            truth = q_on(m, 384, 2500.0)[t]
            cells = [f"{difference(q_on(m, n, 2500.0)[t], truth)[0]:.3f}" for n in (128, 192, 256)]
            rows.append([f"{m}³", f"{t:g}", *cells])
    return table(["points of Q", "t", "solved on 128³", "192³", "256³"], rows)


@cache
def q_on(points: int, resolution: int, reynolds: float) -> dict[float, NDArray[np.float32]]:
    """Q (z, y, x) at t = 5 ... 8 of the velocity that `points`³ keep of a run on `resolution`³."""
    flow = TaylorGreen(resolution=resolution, reynolds=reynolds)
    fields = {}
    for t, state in states(resolution, reynolds).items():
        coarse, modes = flow.coarsened(state, points)
        fields[t] = coarse.q_criterion(modes)
    return fields


@cache
def states(resolution: int, reynolds: float) -> dict[float, FlowState]:
    flow = TaylorGreen(resolution=resolution, reynolds=reynolds)
    states_at, state = {}, flow.initial()
    for t in (5.0, 6.0, 7.0, 8.0):
        states_at[t] = state = flow.advance(state, until=t)
    return states_at


def convergence() -> str:
    names, cfls = ("vortex: energy", "helical: energy", "helical: helicity"), (1.0, 0.5, 0.25, 0.125)
    rows_by_cfl = [invariants(cfl) for cfl in cfls]
    rows = []
    for i, (cfl, errors) in enumerate(zip(cfls, rows_by_cfl, strict=True)):
        cells = [f"{cfl:g}"]
        for j, error in enumerate(errors):
            order = "" if i == 0 else f"{np.log2(rows_by_cfl[i - 1][j] / error):.2f}"
            cells += [f"{error:.1e}", order]
        rows.append(cells)
    return table(["CFL", *(cell for name in names for cell in (name, "order"))], rows)


def invariants(cfl: float) -> list[float]:
    """|E / E0 - 1| of the vortex; |E / E0 - 1|, |H / H0 - 1| of a helical flow; all without viscosity, float64."""
    flow = TaylorGreen(resolution=32, reynolds=np.inf, dtype="float64", cfl=cfl)
    vortex = abs(flow.kinetic_energy(flow.advance(flow.initial(), until=5.0)) / 0.125 - 1.0)
    box = PeriodicBox(24, 0.0, dtype="float64", cfl=cfl)
    start = box.initial(helical_velocity(24))
    end = box.advance(start, until=2.0)
    energy = abs(box.kinetic_energy(end) / box.kinetic_energy(start) - 1.0)
    helicity = abs(box.helicity(end) / box.helicity(start) - 1.0)
    return [vortex, energy, helicity]


def helical_velocity(n: int) -> NDArray[np.float64]:
    """A Beltrami flow disturbed by random waves of |k_i| <= 3, (3, z, y, x)."""
    rng = np.random.default_rng(0)
    points = 2.0 * np.pi * np.arange(n) / n
    z, y, x = np.meshgrid(points, points, points, indexing="ij")
    velocity = np.stack([np.sin(z) + np.cos(y), np.sin(x) + np.cos(z), np.sin(y) + np.cos(x)])
    for k in rng.integers(-3, 4, size=(12, 3)):
        phase = k[0] * x + k[1] * y + k[2] * z + rng.uniform(0.0, 2.0 * np.pi, (3, 1, 1, 1))
        velocity += rng.normal(size=(3, 1, 1, 1)) * np.cos(phase)
    return 0.3 * velocity


def step_and_precision() -> str:
    """Error of Q at 64³, Re 2500, by the time step and by float32, against float64 at CFL 0.05."""
    rows = []
    for t in (5.0, 8.0):
        exact = TaylorGreen(reynolds=2500.0, dtype="float64", cfl=0.05)
        truth = exact.q_criterion(exact.advance(exact.initial(), until=t))
        for cfl in (1.0, 0.5, 0.25):
            cells = [f"{t:g}", f"{cfl:g}"]
            for dtype in ("float64", "float32"):
                flow = replace(exact, dtype=dtype, cfl=cfl)
                q = flow.q_criterion(flow.advance(flow.initial(), until=t))
                cells.append(f"{np.linalg.norm(q - truth) / np.linalg.norm(truth):.1e}")
            rows.append(cells)
    return table(["t", "CFL", "float64: relative L2 error of Q", "float32"], rows)


def planar_decay() -> str:
    """Largest velocity error of the exact decaying two-dimensional vortex at t = 10, ν = 0.01, velocity 1."""
    rows = []
    for n in (16, 64):
        x = 2.0 * np.pi * np.arange(n) / n
        start = np.stack([np.outer(np.cos(x), np.sin(x)), -np.outer(np.sin(x), np.cos(x))])  # (2, y, x)
        cells = [f"{n}²"]
        for dtype in ("float64", "float32"):
            box = PeriodicBox(n, 0.01, dimension=2, dtype=dtype)
            end = box.velocity(box.advance(box.initial(start), until=10.0))
            cells.append(f"{np.abs(end - start * np.exp(-0.2)).max():.1e}")
        rows.append(cells)
    return table(["points", "float64", "float32"], rows)


def twins() -> str:
    """Both solvers at the same small time step, and their times per member (processor seconds to t = 5)."""
    rows = []
    for n in (32, 64):
        flow = TaylorGreen(resolution=n, dtype="float64", cfl=0.1)
        box = PeriodicBox(n, flow.viscosity, dtype="float64", cfl=0.1)
        start = box.initial(flow.velocity(flow.initial()))
        until = 5.0 if n == 32 else 2.0
        velocity = flow.velocity(flow.advance(flow.initial(), until=until))
        difference = np.abs(velocity - box.velocity(box.advance(start, until=until))).max()
        flow, box = replace(flow, dtype="float32", cfl=0.5), replace(box, dtype="float32", cfl=0.5)
        plain = processor_seconds(
            lambda box=box, flow=flow: box.advance(box.initial(flow.velocity(flow.initial())), until=5.0)
        )
        fast = processor_seconds(lambda flow=flow: flow.advance(flow.initial(), until=5.0))
        rows.append(
            [f"{n}³", f"{difference:.0e} (t = {until:g})", f"{plain:.2f} s", f"{fast:.3f} s", f"{plain / fast:.0f}x"]
        )
    return table(["points", "largest difference of u", "plain", "symmetric", "ratio"], rows)


def times(resolutions: Sequence[int]) -> str:
    rows = [
        [f"{n}³", f"{len(history(n, 1600.0).times) - 1}", f"{history(n, 1600.0).seconds:.2f} s"] for n in resolutions
    ]
    return table(["points", "steps to t = 10", "processor time, with E and dissipation at every step"], rows)


def figure(reference: NDArray[np.float64], resolutions: Sequence[int]) -> None:
    rows, fine = reference[reference[:, 0] <= 10.0], history(256, 2500.0)
    with panels(FIGURE, 3, width=4.3) as (energy, dissipation, error):
        for n in resolutions:
            run = history(n, 1600.0)
            energy.plot(run.times, run.energy, label=f"{n}³")
            dissipation.plot(run.times, run.dissipation, label=f"{n}³")
        energy.plot(rows[:, 0], rows[:, 1], "k.", label="512³, Dairay et al. 2017")
        dissipation.plot(rows[:, 0], rows[:, 3], "k.", label="512³, Dairay et al. 2017")
        energy.set(xlabel="t", ylabel="kinetic energy", title="Re 1600")
        dissipation.set(xlabel="t", ylabel="dissipation 2νΩ", title="Re 1600")
        for n in (64, 96, 128, 192):
            errors = [difference(history(n, 2500.0).coarsened[t], fine.coarsened[t])[0] for t in Q_TIMES]
            error.semilogy(Q_TIMES, errors, ".-", label=f"solved on {n}³")
        label = "relative L2 difference to 256³"
        error.set(xlabel="t", ylabel=label, title="Q on 64³ points, Re 2500", ylim=(1e-4, 3.0))
        for axes in (energy, dissipation, error):
            axes.legend()


def load_reference() -> NDArray[np.float64]:
    """The reference's rows; ends the benchmark with instructions where the real data are missing."""
    path = Path(os.environ.get("GS_SURROGATE_DATA", PROJECT.parent / "shared" / "data")) / REFERENCE
    if path.is_file():
        return np.loadtxt(path)
    raise SystemExit(f"this benchmark compares with {path}, which is not here: set GS_SURROGATE_DATA to its folder")


def main() -> None:
    parser = command_line("simulation.taylor_green", __doc__)
    parser.add_argument("--machine", default=f"{os.cpu_count()} cores", help="written beside the results")
    parser.add_argument("--finest", action="store_true", help="also compare with a run on 384³ (six minutes more)")
    parser.add_argument("--parts", nargs="+", metavar="PART", help="measure only these, and leave the figure")
    arguments = parser.parse_args()
    reference = load_reference()
    available = sections(reference, arguments.finest)
    if unknown := set(arguments.parts or ()) - set(available):
        parser.error(f"there are no parts {sorted(unknown)}; known are {', '.join(available)}")
    parts = {
        name: partial(titled_part, *section)
        for name, section in available.items()
        if name in (arguments.parts or available)
    }
    command = "simulation.taylor_green" + " --finest" * arguments.finest
    folders = "insitu/simulations", "research/benchmarks/simulation/taylor_green.py"
    made = made_by(command, *folders, on=arguments.machine, environment="OMP_NUM_THREADS=1 ")
    failed = write_parts(PAGE, parts, made, stopwatch())
    if not arguments.parts:
        figure(reference, RESOLUTIONS)
    sys.exit(bool(failed))


def titled_part(title: str, measure: Callable[[], str]) -> str:
    return titled(title, measure())


def sections(reference: NDArray[np.float64], with_finest: bool) -> dict[str, tuple[str, Callable[[], str]]]:
    """Title and measurement by name."""
    parts: dict[str, tuple[str, Callable[[], str]]] = {
        "reference": (
            "Against the reference at Re 1600 (largest deviation; dissipation relative to the peak)",
            lambda: against_reference(reference, RESOLUTIONS),
        ),
        "pointwise": ("Is Q converged in space?", pointwise),
        "coarsened": (
            "And solved on n³ points, coarsened to 64³? (relative L2 / max difference over max, against 256³)",
            coarsened,
        ),
        "scene": ("The scene tgv: Q on 64³ points, solved on n³ (relative L2 difference to 256³)", scene),
        "finest": ("And is 256³ enough? (Re 2500, relative L2 difference to 384³)", finest),
        "steps": ("Error of Q by time step and precision (64³, Re 2500)", step_and_precision),
        "invariants": (
            "Inviscid invariants (float64; vortex at 32³ to t = 5, helical flow at 24³ to t = 2)",
            convergence,
        ),
        "decay": (
            "Exact decaying two-dimensional vortex, ν = 0.01, t = 10: largest error of the velocity",
            planar_decay,
        ),
        "twins": ("Symmetric and plain solver (float64 at CFL 0.1; times: float32 at CFL 0.5 to t = 5)", twins),
        "times": ("Time of one member on one core (float32, CFL 0.5)", lambda: times(RESOLUTIONS)),
    }
    return parts if with_finest else {name: section for name, section in parts.items() if name != "finest"}


if __name__ == "__main__":
    main()
