"""A member's scalar fields: one array, several by name, or blocks on the ranks of an MPI job."""
