"""File formats: crash-safe writing, PNG and other images, the Cinema CSV table, packed HDF5 members."""
