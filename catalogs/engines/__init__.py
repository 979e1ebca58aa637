"""Engines that run independent, picklable functions: any executor, or the workers of a Dask cluster."""
