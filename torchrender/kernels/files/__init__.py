"""Compressed parts of files."""
