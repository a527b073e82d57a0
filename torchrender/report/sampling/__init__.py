"""Which depth images hold how much of a scene."""
