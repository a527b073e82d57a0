"""Scattering measured: errors and times beside published figures, baselines and peers."""
