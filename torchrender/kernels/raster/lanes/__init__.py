"""The innermost steps of drawing, in vectors."""
