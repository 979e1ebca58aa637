"""The splatting engine's speed beside its error: `python -m research.benchmarks.splatting`."""
