"""The page of tables and pictures that says how good a surrogate is."""
