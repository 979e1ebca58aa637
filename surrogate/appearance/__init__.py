"""Value-carrying Gaussians under transfer functions."""
