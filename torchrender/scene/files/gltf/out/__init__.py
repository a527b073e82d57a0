"""Writing GLB files."""
