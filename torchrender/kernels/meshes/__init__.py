"""Meshes of files: welding, normals."""
