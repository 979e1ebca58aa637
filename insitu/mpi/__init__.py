"""Ranks of an MPI job: collective calls, the layout of blocks, their neighbours."""
