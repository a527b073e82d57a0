"""Photographs as input: what they say about a scene, or a scene about them."""
