"""Compiled loops of gradient-enhanced rendering."""
