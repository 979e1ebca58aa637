"""Pictures, tables, films and Gaussians as files."""
