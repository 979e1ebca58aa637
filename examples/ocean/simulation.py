"""A tropical ocean that trade winds set in motion, by Veros: the thermocline tilts, and cold water rises along the equator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from loguru import logger
from veros import VerosSetup, runtime_settings, veros_routine

from insitu.fields.field import Field

runtime_settings.diskless_mode = True  # nothing is written: the field goes to the hook

from veros.core.operators import at, update  # noqa: E402  locks the settings

logger.disable("veros")

DAY = 86400.0
WEST, SOUTH, WIDTH, HEIGHT, DEPTH = 0.0, -20.0, 60.0, 40.0, 400.0  # the box: degrees and metres
WARM, COLD, THERMOCLINE, THICKNESS = 28.0, 12.0, 120.0, 50.0  # °C and metres: at rest, before the wind sets in
STRESS = 0.06  # N/m² of the westward wind stress at the equator, which `wind` amplifies
HALOS = 2  # cells around the domain in every array of Veros


def simulate(
    parameters: Mapping[str, float], times: Sequence[float], cells: Sequence[int], step: float
) -> Iterator[Field]:
    """The potential temperature (°C) after each of `times`, in days of wind; NaN on land.

    Parameters are `wind`, which amplifies the wind stress, `K_gm` of Gent and McWilliams (m²/s) and the lateral viscosity `A_h`
    (m²/s).  `cells` are along x, y and z; the time `step` is in seconds.
    """
    ocean = TropicalOcean(override={"nx": cells[0], "ny": cells[1], "nz": cells[2]})
    ocean.parameters, ocean.step_seconds = dict(parameters), step
    ocean.setup()
    for time in times:
        while float(ocean.state.variables.time) < time * DAY - 0.5 * step:
            ocean.step(ocean.state)
        yield temperature(ocean.state, time)


def temperature(state: Any, time: float) -> Field:
    vs = state.variables
    inner = slice(HALOS, -HALOS)
    values = np.where(vs.maskT > 0, vs.temp[..., vs.tau], np.nan)[inner, inner].T  # [z, y, x]
    axes = np.asarray(vs.xt)[inner], np.asarray(vs.yt)[inner], np.asarray(vs.zt) * HEIGHT_OF_METRE
    spacing = tuple(float(axis[1] - axis[0]) for axis in axes)
    return Field(values.astype(np.float32), spacing, tuple(float(axis[0]) for axis in axes), "temperature", "°C", time)


HEIGHT_OF_METRE = 0.08  # degrees: how tall a metre of depth is drawn


class TropicalOcean(VerosSetup):
    parameters: dict[str, float]
    step_seconds: float

    @veros_routine
    def set_parameter(self, state: Any) -> None:
        settings = state.settings
        settings.identifier = "tropics"
        settings.dt_mom = settings.dt_tracer = self.step_seconds
        settings.runlen = 0.0
        settings.x_origin, settings.y_origin, settings.coord_degree = WEST, SOUTH, True
        settings.eq_of_state_type = 1
        settings.enable_neutral_diffusion = settings.enable_skew_diffusion = True
        settings.K_gm_0 = settings.K_iso_0 = self.parameters["K_gm"]
        settings.K_iso_steep, settings.iso_dslope, settings.iso_slopec = 500.0, 0.005, 0.01
        settings.enable_hor_friction, settings.A_h = True, self.parameters["A_h"]
        settings.enable_bottom_friction, settings.r_bot = True, 1e-6
        settings.enable_implicit_vert_friction = True
        settings.kappaH_0, settings.kappaM_0 = 2e-5, 2e-3
        settings.enable_superbee_advection = True

    @veros_routine
    def set_grid(self, state: Any) -> None:
        vs, settings = state.variables, state.settings
        vs.dxt = update(vs.dxt, at[...], WIDTH / settings.nx)
        vs.dyt = update(vs.dyt, at[...], HEIGHT / settings.ny)
        vs.dzt = update(vs.dzt, at[...], DEPTH / settings.nz)

    @veros_routine
    def set_coriolis(self, state: Any) -> None:
        vs, settings = state.variables, state.settings
        vs.coriolis_t = update(vs.coriolis_t, at[...], 2.0 * settings.omega * np.sin(np.deg2rad(vs.yt))[None, :])

    @veros_routine
    def set_topography(self, state: Any) -> None:
        vs = state.variables
        x, y = np.meshgrid(vs.xt, vs.yt, indexing="ij")
        west = 8.0 + 7.0 * np.exp(-(((y + 6.0) / 7.0) ** 2)) + 0.35 * np.maximum(y, 0.0) * -0.6 + 3.0
        east = 52.0 - 9.0 / (1.0 + np.exp(-(y - 5.0) / 1.5))
        vs.kbot = update(vs.kbot, at[...], ((x > west) & (x < east)).astype(int))

    @veros_routine
    def set_initial_conditions(self, state: Any) -> None:
        vs = state.variables
        profile = COLD + (WARM - COLD) * 0.5 * (1.0 + np.tanh((vs.zt + THERMOCLINE) / THICKNESS))
        vs.temp = update(vs.temp, at[...], (profile * vs.maskT)[..., None])
        vs.salt = update(vs.salt, at[...], 35.0 * vs.maskT[..., None])
        stress = -STRESS * self.parameters["wind"] * np.exp(-((vs.yt / 15.0) ** 2))
        vs.surface_taux = update(vs.surface_taux, at[...], stress[None, :] * vs.maskU[:, :, -1])

    @veros_routine
    def set_forcing(self, state: Any) -> None:
        pass

    @veros_routine
    def set_diagnostics(self, state: Any) -> None:
        pass

    @veros_routine
    def after_timestep(self, state: Any) -> None:
        pass
