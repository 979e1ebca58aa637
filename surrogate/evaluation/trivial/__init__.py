"""Trivial predictors, which any useful surrogate must beat."""
