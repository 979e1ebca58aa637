"""Reliability of an image: the stored truth, and the error to expect where there is none."""
