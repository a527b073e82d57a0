"""RGB-D photos with poses become textured planes and points that can be viewed from anywhere."""
