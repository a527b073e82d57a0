"""Ambient visibility: how much of the light from everywhere reaches what is seen."""
