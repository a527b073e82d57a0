"""Damaged files: whatever is done to them, a scene or one of the package's errors comes out."""
