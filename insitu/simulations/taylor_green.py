"""The Taylor-Green vortex (Taylor & Green 1937) from t = 0 into turbulence, at a cost that its symmetries allow.

u = sin x cos y cos z,  v = -cos x sin y cos z,  w = 0  at t = 0 in the periodic box [0, 2π)³, ν = 1 / Re.

The equations solved, the 2/3 rule (cubic) and the exact Galerkin truncation are those of its reference
implementation beside the tests.  This flow fills only a part of that one's modes, since it keeps the symmetries of the initial
condition for all time (Brachet et al. 1983, J. Fluid Mech. 130, section 2).

1. Mirrors at x, y, z = 0 and π:  u = Σ û sin(kx x) cos(ky y) cos(kz z),  v: cos sin cos,  w: cos cos sin,  û real.
2. Half turns about the axes x = y = π/2 and so on: kx, ky, kz are all even or all odd.  Write u = E + O, the even
   part plus the odd part.  The flow seen in a mirror at π/2 is E - O, up to signs of components: the cube [0, π/2]³ of both
   holds everything.
3. A quarter turn about x = y = π/2:  v̂(kx, ky, kz) = ±û(ky, kx, kz), + where even and - where odd (`_swap`), and w
   swaps into itself.

A state's modes are therefore real, (2 parities, 2 components u w, kz, ky, kx): 1/48 of the plain method's numbers.  At
such sizes a transform is cheapest as three small matrix products, which also leave out the cut modes for free.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insitu.simulations.runge_kutta import FlowState, Modes, Tendency, last_of
from insitu.simulations.runge_kutta import steps as runge_kutta_steps

Sines = tuple[bool, bool, bool]
"""For (x, y, z): is the series one of sines (else cosines) in that direction?"""

Series = tuple[NDArray[Any], Sines]
"""A scalar field: its modes [2, z, y, x] and what they multiply."""

Matrices = tuple[NDArray[Any], ...]

U, V, W = (True, False, False), (False, True, False), (False, False, True)
U_U, U_V, U_W = (False, False, False), (True, True, False), (True, False, True)
NEVER = 1e4  # a time beyond all runs: on the way there, steps are as long as the CFL number allows
PARITY_SIGN = np.array([1.0, -1.0], dtype=np.float32).reshape(2, 1, 1, 1)


@dataclass(frozen=True)
class TaylorGreen:
    """The Taylor-Green vortex on `resolution`³ points of [0, 2π)³.

    Parameters
    ----------
    resolution : a multiple of 4, at least 8; wavenumbers below a third of it are kept.
    reynolds : 1 / ν, with the vortex's velocity and length as units; infinity is allowed.
    dtype : "float32" or "float64".
    cfl : dt * max(|u| + |v| + |w|) / spacing; linear stability ends at 1.35 (classical Runge-Kutta up to k = n / 3).

    `spacing` and `origin` place the point samples for rendering, (x, y, z) order: points 2π i / n, i = 0 ... n - 1.
    The periodic repetition of plane 0 at 2π is not stored, so a rendered box spans n - 1 cells, [0, 2π - spacing].

    Limits: only this initial condition; disturbances that break its symmetries, which a real
    flow would amplify, cannot occur; under-resolved once the smallest eddies are.

    >>> flow = TaylorGreen(resolution=16, reynolds=100.0)
    >>> state = flow.advance(flow.initial(), until=1.0)
    >>> flow.q_criterion(state).shape
    (16, 16, 16)
    >>> f"{flow.kinetic_energy(flow.initial()):.3f} -> {flow.kinetic_energy(state):.3f}"
    '0.125 -> 0.117'
    """

    resolution: int = 64
    reynolds: float = 1600.0
    dtype: str = "float32"
    cfl: float = 0.5

    def __post_init__(self) -> None:
        if not isinstance(self.resolution, int) or self.resolution < 8 or self.resolution % 4:
            raise ValueError(f"resolution must be a multiple of 4 and at least 8, got {self.resolution}")
        if not self.reynolds > 0.0:
            raise ValueError(f"the Reynolds number must be positive, got {self.reynolds}")
        if not 0.0 < self.cfl <= 1.35:
            raise ValueError(f"cfl must lie in (0, 1.35], where the method is stable, got {self.cfl}")
        if self.dtype not in ("float32", "float64"):
            raise ValueError(f"dtype must be 'float32' or 'float64', got {self.dtype!r}")

    @property
    def viscosity(self) -> float:
        return 1.0 / self.reynolds

    @property
    def spacing(self) -> tuple[float, float, float]:
        return (2.0 * np.pi / self.resolution,) * 3

    @property
    def origin(self) -> tuple[float, float, float]:
        return (0.0, 0.0, 0.0)

    def initial(self) -> FlowState:
        """The vortex at time 0: one odd mode of u."""
        modes = np.zeros((2, 2) + (self._mode_count,) * 3, dtype=self.dtype)
        modes[1, 0, 0, 0, 0] = 1.0
        return FlowState(0.0, modes)

    def steps(self, state: FlowState, until: float) -> Iterator[FlowState]:
        """States after each time step, the last one at exactly `until`: for loops with progress or in situ hooks."""
        return runge_kutta_steps(
            state, until, tendency=self._make_tendency(), decay=self._decay, step_limit=self.cfl * self.spacing[0]
        )

    def advance(self, state: FlowState, *, until: float) -> FlowState:
        """The state at time `until`."""
        return last_of(self.steps(state, until), state)

    def coarsened(self, state: FlowState, resolution: int) -> tuple[TaylorGreen, FlowState]:
        """The same flow seen on fewer points: the state's modes that `resolution` points keep, and their solver.

        Eddies that such a grid cannot hold are left out (a sharp low-pass filter), so what is computed from the result
        is smooth on that grid.  Raises ValueError where `resolution` is finer than this flow's.
        """
        coarse = replace(self, resolution=resolution)
        if resolution > self.resolution:
            raise ValueError(f"a flow of {self.resolution} points cannot be coarsened to {resolution}")
        count = coarse._mode_count
        resolved = np.all(
            [3 * k < resolution for k in np.broadcast_arrays(*coarse._wavenumbers)], axis=0
        )  # [2, H, H, H]
        return coarse, FlowState(state.time, state.modes[..., :count, :count, :count] * resolved[:, None])

    def velocity(self, state: FlowState) -> NDArray[Any]:
        """Velocity (3, z, y, x), components in (x, y, z) order, on the grid points."""
        return np.stack([self._on_grid(series) for series in self._velocity_series(state)])

    def vorticity(self, state: FlowState) -> NDArray[Any]:
        """∇ x u (3, z, y, x), components in (x, y, z) order, on the grid points."""
        u, v, w = (_gradient(series, self._wavenumbers) for series in self._velocity_series(state))
        pairs = ((w[1], v[2]), (u[2], w[0]), (v[0], u[1]))
        return np.stack([self._on_grid(a) - self._on_grid(b) for a, b in pairs])

    def q_criterion(self, state: FlowState) -> NDArray[Any]:
        """Q = (|Ω|² - |S|²) / 2 = -1/2 ∂_i u_j ∂_j u_i (z, y, x), from derivatives in spectral space.

        Ω and S are the antisymmetric and the symmetric part of the velocity gradient (Hunt, Wray & Moin 1988): Q > 0
        where rotation outweighs strain.
        """
        gradients = [_gradient(series, self._wavenumbers) for series in self._velocity_series(state)]
        q = np.zeros((self.resolution,) * 3, dtype=self.dtype)
        for i in range(3):
            diagonal = self._on_grid(gradients[i][i])  # gradients[component][direction]
            q -= 0.5 * diagonal * diagonal
            for j in range(i + 1, 3):
                q -= self._on_grid(gradients[i][j]) * self._on_grid(gradients[j][i])
        return q

    def kinetic_energy(self, state: FlowState) -> float:
        """<|u|²> / 2 over the box."""
        return 0.5 * self._mean_square(state, 1.0)

    def enstrophy(self, state: FlowState) -> float:
        """<|∇ x u|²> / 2 over the box."""
        return 0.5 * self._mean_square(state, self._squared_wavenumber)

    def dissipation(self, state: FlowState) -> float:
        """-dE/dt by viscosity: 2 ν times the enstrophy."""
        return 2.0 * self.viscosity * self.enstrophy(state)

    def _make_tendency(self) -> Tendency:
        """Advection N = -P ∇·(u u) with its own buffers; P projects onto divergence-free fields."""
        kx, ky, kz = self._wavenumbers
        inverse_square = 1.0 / np.where(self._squared_wavenumber == 0.0, np.inf, self._squared_wavenumber)
        points = (np.arange(self.resolution // 4) + 0.5) * self.spacing[0]  # midpoints of [0, π/2]
        synthesis = self._synthesis((U, W), points)
        analysis = self._analysis((U_U, U_V, U_W), points)
        shape = (points.size,) * 3
        flow = np.empty((2, 2, *shape), dtype=self.dtype)  # [flow or its mirror image, (u, w), z, y, x]
        products, mirrored = np.empty((2, 2, 3, *shape), dtype=self.dtype)
        speed, scratch = np.empty((2, 2, *shape), dtype=self.dtype)

        def tendency(modes: Modes, out: Modes) -> float:
            _with_mirror_image(_transform(modes, synthesis), out=flow)
            u, w = flow[:, 0], flow[:, 1]
            v = u[::-1].swapaxes(-1, -2)

            np.abs(u, out=speed)
            for component in (v, w):
                np.abs(component, out=scratch)
                np.add(speed, scratch, out=speed)

            np.multiply(u, u, out=products[:, 0])
            np.multiply(w, w, out=scratch)
            products[:, 0] -= scratch  # the trace w² δ_ij is left to the pressure (Basdevant 1983)
            np.multiply(u, v, out=products[:, 1])
            np.multiply(u, w, out=products[:, 2])
            fluxes = _transform(_with_mirror_image(products, out=mirrored), analysis)
            uu, uv, uw = fluxes[:, 0], fluxes[:, 1], fluxes[:, 2]

            advected_u, advected_w = out[:, 0], out[:, 1]
            advected_u[...] = kx * uu - ky * uv - kz * uw
            advected_w[...] = -kx * uw - ky * _swap(uw)
            pressure = (kx * advected_u + ky * _swap(advected_u) + kz * advected_w) * inverse_square
            advected_u -= kx * pressure
            advected_w -= kz * pressure
            return float(speed.max())

        return tendency

    def _decay(self, dt: float) -> Modes:
        factor: Modes = np.exp(-self.viscosity * dt * self._squared_wavenumber)[:, None]
        return factor

    def _mean_square(self, state: FlowState, weight: float | NDArray[Any]) -> float:
        """Sum of squared modes times `weight`, each times the mean of its squared basis function."""
        wavenumbers = self._wavenumbers
        mean = np.prod([np.where(k == 0.0, 1.0, 0.5) for k in np.broadcast_arrays(*wavenumbers)], axis=0)
        u, w = state.modes[:, 0].astype(np.float64), state.modes[:, 1].astype(np.float64)
        return float(((2.0 * u * u + w * w) * mean * weight).sum())

    def _velocity_series(self, state: FlowState) -> tuple[Series, Series, Series]:
        u, w = state.modes[:, 0], state.modes[:, 1]
        return (u, U), (_swap(u), V), (w, W)

    def _on_grid(self, series: Series) -> NDArray[Any]:
        """A series' values (z, y, x) on the grid points of the whole box."""
        modes, sines = series
        points = np.arange(self.resolution) * self.spacing[0]
        matrices = [matrix[:, 0] for matrix in self._synthesis((sines,), points)]
        even, odd = (_transform(modes[parity], [matrix[parity] for matrix in matrices]) for parity in (0, 1))
        even += odd
        return even

    def _synthesis(self, fields: Sequence[Sines], points: NDArray[Any]) -> Matrices:
        """Matrices (z, y, x) of [2, F, H, P] from modes to values at `points` in every direction."""
        per_axis = (np.stack([self._basis(sines[axis], points) for sines in fields], axis=1) for axis in (2, 1, 0))
        return tuple(matrix.astype(self.dtype) for matrix in per_axis)

    def _analysis(self, fields: Sequence[Sines], points: NDArray[Any]) -> Matrices:
        """Matrices (z, y, x) of [2, F, P, H] from values at midpoints of [0, π/2], flow ± mirror image, to modes."""
        norm = np.where(self._mode_numbers == 0, 1.0, 2.0)[:, None, None, :] / points.size  # [2, 1, 1, H]
        z, y, x = (matrix.swapaxes(-1, -2) * norm for matrix in self._synthesis(fields, points))
        return tuple(matrix.astype(self.dtype) for matrix in (0.5 * z, y, x))

    def _basis(self, sine: bool, points: NDArray[Any]) -> NDArray[np.float64]:
        """sin(k x) or cos(k x) as [2, H, P]; zero for the odd wavenumber that the 2/3 rule may cut."""
        phase = self._mode_numbers[:, :, None] * points
        resolved = 3 * self._mode_numbers[:, :, None] < self.resolution
        return (np.sin(phase) if sine else np.cos(phase)) * resolved

    @cached_property
    def _mode_count(self) -> int:
        """H, the number of even wavenumbers below n / 3."""
        return (self.resolution - 1) // 3 // 2 + 1

    @cached_property
    def _mode_numbers(self) -> NDArray[np.int64]:
        """Wavenumbers [2, H] of one direction: even, odd."""
        even = 2 * np.arange(self._mode_count)
        return np.stack([even, even + 1])

    @cached_property
    def _wavenumbers(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """kx [2, 1, 1, H], ky [2, 1, H, 1], kz [2, H, 1, 1]."""
        k = self._mode_numbers.astype(self.dtype)
        return k[:, None, None, :], k[:, None, :, None], k[:, :, None, None]

    @cached_property
    def _squared_wavenumber(self) -> NDArray[Any]:
        kx, ky, kz = self._wavenumbers
        return np.asarray(kx * kx + ky * ky + kz * kz)  # [2, H, H, H]


def _swap(modes: Modes) -> Modes:
    """The quarter turn in modes [2, z, y, x]: x and y change places, odd modes change sign."""
    return modes.swapaxes(-1, -2) * PARITY_SIGN.astype(modes.dtype)


def _gradient(series: Series, wavenumbers: Sequence[NDArray[Any]]) -> list[Series]:
    """The derivatives of a series in x, y and z."""
    modes, sines = series
    terms = []
    for axis, k in enumerate(wavenumbers):
        x, y, z = (sine != (direction == axis) for direction, sine in enumerate(sines))
        terms.append((modes * (k if sines[axis] else -k), (x, y, z)))
    return terms


def _with_mirror_image(parts: NDArray[Any], out: NDArray[Any]) -> NDArray[Any]:
    """(E, O) to (E + O, E - O), and back but for a factor 2, along the first axis."""
    np.add(parts[0], parts[1], out=out[0])
    np.subtract(parts[0], parts[1], out=out[1])
    return out


def _transform(values: NDArray[Any], matrices: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """[..., Z, Y, X] times a matrix [..., Z, Z'] in each of its last three directions.

    A product contracts the first direction and appends the new one last, so that after three all are back in order.
    """
    for matrix in matrices:
        *batch, first, second, third = values.shape
        flat = values.reshape(*batch, first, second * third).swapaxes(-1, -2)
        values = (flat @ matrix).reshape(*batch, second, third, matrix.shape[-1])
    return values
