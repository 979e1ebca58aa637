"""Benchmarks of answers to questions."""
