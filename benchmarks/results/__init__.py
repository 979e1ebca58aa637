"""All scenes' results on one page, read from runs/."""
