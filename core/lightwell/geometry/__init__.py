"""Triangle meshes and the rays that meet them. No input or output here."""
