"""Whole ensembles: files, bundled and hooked simulations, rendered over processes or as they appear."""
