"""Quality over training time."""
