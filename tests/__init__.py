"""A package, so that no other `tests` is taken for it: some dependencies install one beside themselves."""
