"""Fog in photographs, measured."""
