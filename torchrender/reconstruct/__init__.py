"""Surfaces out of depth images, and depth images seen from elsewhere."""
