"""The surrogate compared with published systems: the same images, time and metrics for all."""
