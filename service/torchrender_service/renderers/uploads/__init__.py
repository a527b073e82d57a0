"""Scenes of several files, as uploads bring them."""
