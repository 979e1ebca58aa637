"""Many trainings compared: ablation, seeds, the upper bound of one member fitted alone, and the stress table."""
