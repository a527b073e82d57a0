"""Compiled loops of shadows."""
