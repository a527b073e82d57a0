"""Wavelets of images."""
