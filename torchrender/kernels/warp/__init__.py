"""Compiled loops that show depth images from elsewhere."""
