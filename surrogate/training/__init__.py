"""From a catalog to a surrogate: stages, their loop, and what each needs."""
