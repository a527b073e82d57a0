"""Quads of one image into the target: blocks that are hidden, small ones, and those that reach behind the camera."""
