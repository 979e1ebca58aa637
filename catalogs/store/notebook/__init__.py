"""Cards of facts and small images for notebooks, as HTML."""
