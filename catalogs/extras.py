"""The packages that the extras of this project bring, and the sentence that names the extra of a missing one."""

from __future__ import annotations

OF_PACKAGE = {  # "": the extra of whatever needs it, for several bring it, or all of them
    **dict.fromkeys(("vtkmodules", "pyvista", "defusedxml", "zlib_ng"), "insitu"),
    **dict.fromkeys(("torch", "safetensors", "matplotlib"), "surrogate"),
    **dict.fromkeys(("xarray", "h5netcdf", "zarr"), "xarray"),
    **dict.fromkeys(("pytorch_msssim", "torchmetrics", "flip_evaluator"), "metrics"),
    **dict.fromkeys(("aiohttp", "PIL"), "explore"),
    **dict.fromkeys(("gsplat", "ninja"), "cuda"),
    **dict.fromkeys(("cffi", "setuptools"), "embedding"),
    **dict.fromkeys(("psutil", "click", "numpy", "scipy", "h5py", "OpenImageIO"), ""),
    "netCDF4": "mpas",
    "adios2": "adios2",
    "pycolmap": "sfm",
    "av": "video",
    "distributed": "dask",
    "mpi4py": "mpi",
}
BASE = ("", "insitu", "surrogate")  # which all others contain


def remedy(error: ModuleNotFoundError, needing: str, extra: str) -> str:
    """The sentence that says which package `needing`, a command or a public name, lacks and what installs it.

    `extra` is what installs everything that `needing` usually needs.  An error that names no package has its own sentence.
    Raises the error again where a module of this project itself is missing, which is a bug.
    """
    if error.name is None:
        return str(error)
    package = error.name.partition(".")[0]
    if package in ("catalogs", "insitu", "native", "render", "surrogate"):
        raise error
    if package not in OF_PACKAGE:
        return f"{needing} needs the package {package}, which is not installed"
    bringing = OF_PACKAGE[package]
    if bringing in BASE:
        bringing = extra or bringing
    requirement = f"gs-surrogate[{bringing}]" if bringing else "gs-surrogate"
    return f"{needing} needs the package {package}: pip install '{requirement}'"
