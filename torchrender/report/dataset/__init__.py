"""Many views of a scene in one call, and pictures of a scene in which something moves."""
