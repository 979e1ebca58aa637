"""Many trainings compared: ablation, seeds, the ceiling of one member fitted alone, and the stress table."""
