"""How Gaussians that carry values of a field look under a transfer function."""
