"""Where independent tasks run beside this process: any executor, or the workers of a Dask cluster.

An engine knows nothing of members or trainings: it runs picklable functions of no arguments.  Both halves use it.
"""
