"""C++ kernels behind plain arrays, and fields that they draw along rays; without torch and without VTK."""
