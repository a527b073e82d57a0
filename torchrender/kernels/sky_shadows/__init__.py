"""What spheres hide of a cube map, as bits, and the light that is left."""
