"""Scene files: glTF, OBJ, PLY, STL, MTL, TOML, volumes and textures."""
