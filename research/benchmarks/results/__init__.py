"""All scenes' results on one page, read from their records."""
