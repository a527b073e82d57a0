"""Point models: size, speed, accuracy."""
