"""Compiled loops over point models."""
