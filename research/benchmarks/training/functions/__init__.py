"""A surrogate under transfer functions that it never saw, against the field itself."""
