"""The same training with other seeds: how much of a figure is chance."""
