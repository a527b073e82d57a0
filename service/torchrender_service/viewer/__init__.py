"""Scenes of a running Python program in a browser: a service in a thread of the program itself."""
