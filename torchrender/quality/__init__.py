"""Measures of pictures, of time, and of the machine."""
