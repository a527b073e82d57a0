"""Clustered reflections against rays."""
