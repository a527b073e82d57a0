"""Shape made easier to read: the shading's own gradient, projected into the picture, added to it."""
