"""Ensembles of files: readers, clusters, killed workers."""
