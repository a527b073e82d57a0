"""Reflections used again over time."""
