"""Incompressible flow in a periodic square or cube from any initial velocity: the plain pseudo-spectral method.

∂u/∂t + ∇·(u u) = -∇p + ν ∇²u,  ∇·u = 0  on [0, 2π)^d

Fourier modes with |k_i| < n/3 in every direction (cubic truncation).  Products of two such modes that alias on n points
land outside of these modes (the 2/3 rule, Orszag 1971), so the method is the exact Galerkin truncation.  All forms of the
advection term coincide, and without viscosity energy and helicity are conserved up to the time step's error.
The tensor u_i u_j loses its trace to the pressure and needs five forward transforms instead of six (Basdevant 1983,
J. Comput. Phys. 50).

This is the reference implementation that `insitu.simulations.taylor_green` is tested against, which is far faster for its one flow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import ArrayLike, NDArray

from insitu.simulations.runge_kutta import FlowState, Modes, last_of
from insitu.simulations.runge_kutta import steps as runge_kutta_steps


@dataclass(frozen=True)
class PeriodicBox:
    """A flow on `resolution` points in each of `dimension` (2 or 3) directions of [0, 2π)^d.

    `viscosity` is kinematic; 0 is allowed.  `cfl` is dt * max(|u| + |v| + |w|) / spacing; linear stability ends at
    2.83 * 3 / (2π) = 1.35.  A state's modes are Fourier coefficients (d, [kz,] ky, kx >= 0), components in (x, y, z)
    order.  Velocities are arrays (d, [z,] y, x).
    """

    resolution: int
    viscosity: float
    dimension: int = 3
    dtype: str = "float32"
    cfl: float = 0.5

    def __post_init__(self) -> None:
        if self.dimension not in (2, 3) or self.resolution < 4:
            raise ValueError(f"dimension must be 2 or 3 and resolution at least 4, got {self}")
        if not (np.isfinite(self.viscosity) and self.viscosity >= 0.0 and self.cfl > 0.0):
            raise ValueError(f"viscosity must be finite and not negative, cfl positive, got {self}")
        if self.dtype not in ("float32", "float64"):
            raise ValueError(f"dtype must be 'float32' or 'float64', got {self.dtype!r}")

    @property
    def spacing(self) -> float:
        return 2.0 * np.pi / self.resolution

    def initial(self, velocity: ArrayLike) -> FlowState:
        """The state at time 0 of `velocity` (d, [z,] y, x), freed of divergence and of modes beyond the 2/3 rule."""
        velocity = np.asarray(velocity, dtype=self.dtype)
        expected = (self.dimension,) + (self.resolution,) * self.dimension
        if velocity.shape != expected or not np.isfinite(velocity).all():
            raise ValueError(f"the initial velocity must be finite and of shape {expected}, got {velocity.shape}")
        modes = self._forward(velocity)
        self._project(modes)
        return FlowState(0.0, modes)

    def steps(self, state: FlowState, until: float) -> Iterator[FlowState]:
        """States after each time step, the last one at exactly `until`."""
        return runge_kutta_steps(
            state, until, tendency=self._tendency, decay=self._decay, step_limit=self.cfl * self.spacing
        )

    def advance(self, state: FlowState, *, until: float) -> FlowState:
        """The state at time `until`."""
        return last_of(self.steps(state, until), state)

    def velocity(self, state: FlowState) -> NDArray[Any]:
        """Velocity (d, [z,] y, x) on the grid points 2π i / n."""
        return self._inverse(state.modes)

    def gradient(self, state: FlowState) -> NDArray[Any]:
        """∂_i u_j as (i, j, [z,] y, x)."""
        return np.stack([self._inverse(1j * k * state.modes) for k in self._wavenumbers])

    def vorticity(self, state: FlowState) -> NDArray[Any]:
        """∇ x u (3, z, y, x) of a flow in three dimensions."""
        gradient = self.gradient(state)  # [i, j, z, y, x]
        return np.stack([gradient[i, j] - gradient[j, i] for i, j in ((1, 2), (2, 0), (0, 1))])

    def q_criterion(self, state: FlowState) -> NDArray[Any]:
        """Q = -1/2 ∂_i u_j ∂_j u_i ([z,] y, x)."""
        gradient = self.gradient(state)
        return -0.5 * np.einsum("ij...,ji...->...", gradient, gradient)

    def kinetic_energy(self, state: FlowState) -> float:
        """<|u|²> / 2 over the box."""
        return 0.5 * self._sum_over_modes(state, 1.0)

    def enstrophy(self, state: FlowState) -> float:
        """<|∇ x u|²> / 2 over the box."""
        return 0.5 * self._sum_over_modes(state, self._squared_wavenumber)

    def dissipation(self, state: FlowState) -> float:
        """-dE/dt by viscosity: 2 ν times the enstrophy."""
        return 2.0 * self.viscosity * self.enstrophy(state)

    def helicity(self, state: FlowState) -> float:
        """<u · ∇ x u> over the box, of a flow in three dimensions."""
        product = np.einsum("i...,i...->...", self.velocity(state), self.vorticity(state))
        return float(product.mean(dtype=np.float64))

    def _tendency(self, modes: Modes, out: Modes) -> float:
        """N_i = -P_ij i k_l (u_j u_l)^ and the speed; P is the projection onto divergence-free fields."""
        velocity = self._inverse(modes)
        speed = float(np.abs(velocity).sum(axis=0).max())
        trace = velocity[-1] ** 2
        last = self.dimension - 1
        out[...] = 0.0
        for i, j in combinations_with_replacement(range(self.dimension), 2):
            if i == j == last:
                continue
            product = velocity[i] * velocity[j]
            if i == j:
                product -= trace
            flux = self._forward(product)
            out[i] -= 1j * self._wavenumbers[j] * flux
            if i != j:
                out[j] -= 1j * self._wavenumbers[i] * flux
        self._project(out)
        return speed

    def _project(self, modes: Modes) -> None:
        """In place: cut modes beyond the 2/3 rule and subtract the gradient part, û - k (k · û) / k²."""
        modes *= self._kept
        potential = sum(k * component for k, component in zip(self._wavenumbers, modes, strict=True))
        potential /= np.where(self._squared_wavenumber == 0.0, 1.0, self._squared_wavenumber)
        for k, component in zip(self._wavenumbers, modes, strict=True):
            component -= k * potential

    def _decay(self, dt: float) -> Modes:
        return np.exp(-self.viscosity * dt * self._squared_wavenumber)

    def _sum_over_modes(self, state: FlowState, weight: float | NDArray[Any]) -> float:
        squares = (state.modes.real.astype(np.float64) ** 2 + state.modes.imag.astype(np.float64) ** 2).sum(axis=0)
        squares[..., 1:] *= 2.0  # the modes of negative kx, which are not stored
        return float((squares * weight).sum())

    def _forward(self, field: NDArray[Any]) -> Modes:
        return np.asarray(scipy.fft.rfftn(field, axes=self._axes, norm="forward"))

    def _inverse(self, modes: Modes) -> NDArray[Any]:
        shape = (self.resolution,) * self.dimension
        return np.asarray(scipy.fft.irfftn(modes, shape, axes=self._axes, norm="forward"))

    @property
    def _axes(self) -> tuple[int, ...]:
        return tuple(range(-self.dimension, 0))

    @cached_property
    def _wavenumbers(self) -> tuple[NDArray[Any], ...]:
        """(kx, ky[, kz]), each of a shape that multiplies a component's modes."""
        n = self.resolution
        whole, half = (k(n, 1.0 / n).astype(self.dtype) for k in (np.fft.fftfreq, np.fft.rfftfreq))
        axes = [whole] * (self.dimension - 1) + [half]  # ([kz,] ky, kx >= 0)
        return tuple(np.meshgrid(*axes, indexing="ij", sparse=True)[::-1])

    @cached_property
    def _squared_wavenumber(self) -> NDArray[Any]:
        return np.asarray(sum(k**2 for k in self._wavenumbers))

    @cached_property
    def _kept(self) -> NDArray[np.bool_]:
        return np.all([3.0 * np.abs(k) < self.resolution for k in np.broadcast_arrays(*self._wavenumbers)], axis=0)
