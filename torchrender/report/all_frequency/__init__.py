"""Shadows of moving objects under the sky: errors and times beside brute force and spherical harmonics."""
