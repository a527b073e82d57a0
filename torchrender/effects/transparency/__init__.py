"""Surfaces that show what lies behind: blended by alpha, or thin walls that let light pass."""
