"""Reprojection: speed and holes."""
