"""Our surrogate beside published systems: the same pictures, time and metrics for all."""
