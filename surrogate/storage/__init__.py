"""What a run keeps on disk: checkpoints, encoded tensors, and results with the settings that made them."""
