"""A run on disk: checkpoints, encoded tensors, and results with the settings that made them."""
