"""From layers to the picture."""
