"""OBJ, PLY and STL: plain mesh files."""
