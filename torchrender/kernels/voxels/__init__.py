"""Compiled loops over voxels."""
