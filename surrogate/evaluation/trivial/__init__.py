"""Predictors that any surrogate must beat, or say by how much it does not."""
