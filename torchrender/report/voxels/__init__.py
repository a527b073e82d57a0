"""Voxels: speed and accuracy."""
