"""Shadows, and light that arrives without detour."""
