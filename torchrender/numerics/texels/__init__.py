"""Texels as they are kept: codes of 8 bits, and levels of detail of 16."""
