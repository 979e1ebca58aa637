"""The same training with other seeds: the random variation of its figures."""
