"""Renderers as processes of this machine: which job comes next, and what happens when one dies."""
