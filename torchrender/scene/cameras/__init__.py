"""Parts of cameras: what they are made of, and the ways in from other programs."""
