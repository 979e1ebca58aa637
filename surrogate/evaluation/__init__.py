"""Evaluation of a surrogate on images that training never used, beside trivial predictors."""
