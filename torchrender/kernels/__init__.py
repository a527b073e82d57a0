"""Compiled inner loops (numba) over numpy views: the only place that imports numba."""
