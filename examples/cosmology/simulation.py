"""Matter in a periodic box of the universe, by JaxPM: fluctuations with the same phases in every member, over three parameters."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from insitu.fields.field import Field

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import itertools

import jax
import jax_cosmo
from jax import numpy as jnp
from jaxpm.painting import cic_paint
from jaxpm.pm import linear_field, lpt, pm_forces

SIZE = 28.0  # Mpc, edge of the box
BARYONS, SPECTRAL_INDEX = 0.0224, 0.965  # density times h² (Planck 2018)
PHASES = 7  # seed of the fluctuations
START = 0.1  # scale factor of the first step


def simulate(
    parameters: Mapping[str, float], samples: int, finer: int, steps: int, redshift: float, smoothing: float
) -> Field:
    """The decimal logarithm of density over mean density at `redshift`, smoothed by a Gaussian of `smoothing` Mpc.

    Parameters are `omega_m`, the density of matter times h², `h`, Hubble's constant by 100 km/s/Mpc, and `sigma8`, how strong the
    fluctuations are in 8 Mpc/h.  `finer` cells and particles make up the side of a sample.
    """
    density = matter(parameters, samples * finer, steps, redshift)
    width = SIZE / samples
    smooth = gaussian_filter(density, smoothing * finer / width, mode="wrap")
    means = smooth.reshape((samples, finer) * 3).mean((1, 3, 5))  # [x, y, z]
    values = np.log10(means).T.astype(np.float32)
    return Field(np.ascontiguousarray(values), (width,) * 3, (width / 2,) * 3, name="density")


def matter(parameters: Mapping[str, float], cells: int, steps: int, redshift: float) -> NDArray[np.float64]:
    """Density over its mean [x, y, z]: leapfrog with even steps of the scale factor, from Zel'dovich's displacements."""
    cosmology, mesh = _cosmology(parameters), (cells,) * 3
    axes = [jnp.arange(cells, dtype=jnp.float32)] * 3
    particles = jnp.stack(jnp.meshgrid(*axes, indexing="ij"), axis=-1)  # [X, Y, Z, 3], in cells
    moved, momenta, _ = lpt(cosmology, _fluctuations(parameters, cells), particles, a=START)
    places = particles + moved
    force = jax.jit(lambda at: 1.5 * cosmology.Omega_m * pm_forces(at, mesh_shape=mesh))

    def expansion(a: float) -> float:
        return float(jnp.sqrt(jax_cosmo.background.Esqr(cosmology, jnp.atleast_1d(a)))[0])

    times = np.linspace(START, 1.0 / (1.0 + redshift), steps + 1)
    pull = force(places)
    for low, high in itertools.pairwise(times):
        a, half = (low + high) / 2.0, (high - low) / 2.0
        momenta = momenta + half / (a**2 * expansion(a)) * pull
        places = places + 2.0 * half / (a**3 * expansion(a)) * momenta
        pull = force(places)
        momenta = momenta + half / (a**2 * expansion(a)) * pull
    return np.asarray(cic_paint(jnp.zeros(mesh), places % cells), np.float64)


def _cosmology(parameters: Mapping[str, float]) -> jax_cosmo.Cosmology:
    """Flat, with a cosmological constant."""
    h = parameters["h"]
    return jax_cosmo.Cosmology(
        Omega_c=(parameters["omega_m"] - BARYONS) / h**2,
        Omega_b=BARYONS / h**2,
        h=h,
        n_s=SPECTRAL_INDEX,
        sigma8=parameters["sigma8"],
        Omega_k=0.0,
        w0=-1.0,
        wa=0.0,
    )


def _fluctuations(parameters: Mapping[str, float], cells: int) -> jax.Array:
    """Today's linear density contrast [x, y, z].  The phases are those of `PHASES`, whatever the parameters."""
    numbers = jnp.logspace(-4, 2, 256)  # h/Mpc
    spectrum = jax_cosmo.power.linear_matter_power(_cosmology(parameters), numbers)

    def power(number: jax.Array) -> jax.Array:
        return jnp.interp(number.reshape(-1), numbers, spectrum).reshape(number.shape)

    box = (SIZE * parameters["h"],) * 3  # Mpc/h
    return linear_field((cells,) * 3, box, power, seed=jax.random.PRNGKey(PHASES))
