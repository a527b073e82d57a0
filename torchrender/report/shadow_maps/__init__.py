"""Shadow maps against rays."""
