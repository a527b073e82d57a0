"""Compiled loops of reflections."""
