"""Soft shadows against many rays."""
