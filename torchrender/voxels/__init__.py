"""Scenes as voxels, and their drawing."""
