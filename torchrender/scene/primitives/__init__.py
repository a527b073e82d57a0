"""Simple shapes."""
