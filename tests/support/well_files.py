"""Files as The Well specifies them, after `the_well.utils.dummy_data`, with three axes of space."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

TRAJECTORIES, STEPS, SHAPE = 2, 3, (4, 5, 6)  # x, y, z
AXES = {"x": np.linspace(0, 3, 4), "y": np.linspace(1, 3, 5), "z": np.linspace(-1, 0, 6)}


def fields(seed: int = 0) -> dict[str, Any]:
    """Random numbers: (trajectory, step, x, y, z), those of vectors and tensors with one and two more axes."""
    random = np.random.default_rng(seed)
    lead = (TRAJECTORIES, STEPS, *SHAPE)
    return {
        "t0_fields/density": random.random(lead, dtype=np.float32),
        "t0_fields/mask": random.random(SHAPE, dtype=np.float32),
        "t0_fields/profile": random.random(SHAPE[:1], dtype=np.float32),
        "t1_fields/velocity": random.random((*lead, 3), dtype=np.float32),
        "t2_fields/stress": random.random((*lead, 3, 3), dtype=np.float32),
    }


def write_well(
    path: Path, parameters: dict[str, float], *, seed: int = 0, times: Any = (0.0, 0.5, 1.5), dims: str = "xyz"
) -> None:
    times = np.asarray(times, dtype=np.float32)
    with h5py.File(path, "w") as file:
        file.attrs.update(dataset_name="test", grid_type="cartesian", n_spatial_dims=3, n_trajectories=TRAJECTORIES)
        file.attrs["simulation_parameters"] = list(parameters)
        file.attrs.update(parameters)
        group = file.create_group("dimensions")
        group.attrs["spatial_dims"] = list(dims)
        group["time"] = times
        group["time"].attrs["sample_varying"] = times.ndim == 2
        for name, values in AXES.items():
            group[name] = values.astype(np.float32)
            group[name].attrs.update(sample_varying=False, time_varying=False)
        group = file.create_group("boundary_conditions").create_group("x_periodic")
        group.attrs.update(associated_dims=["x"], bc_type="PERIODIC", sample_varying=False, time_varying=False)
        group["mask"] = np.zeros(SHAPE[0], dtype=bool)
        group = file.create_group("scalars")
        group.attrs["field_names"] = [*parameters, "energy"]
        for name, value in parameters.items():
            group[name] = value
            group[name].attrs.update(sample_varying=False, time_varying=False)
        group["energy"] = np.zeros(STEPS)
        group["energy"].attrs.update(sample_varying=False, time_varying=True)
        for order in range(3):
            file.create_group(f"t{order}_fields").attrs["field_names"] = [
                name.partition("/")[2] for name in fields() if name.startswith(f"t{order}")
            ]
        for name, values in fields(seed).items():
            varies = values.shape[0] == TRAJECTORIES
            axes = [True] * 3 if values.ndim >= 3 else [True, False, False]
            file[name] = values
            file[name].attrs.update(sample_varying=varies, time_varying=varies, dim_varying=axes)
