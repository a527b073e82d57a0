"""What there is: meshes, materials, lights, media, environment and cameras."""
