"""A surrogate under transfer functions that it was never trained with, against the field itself."""
