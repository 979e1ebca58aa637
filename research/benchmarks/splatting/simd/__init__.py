"""The inner loops of splatting, written with different vector libraries."""
