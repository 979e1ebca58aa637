"""Timings and accuracy measurements, each a command that writes a table or a page of docs/."""
