"""Depth images of clusters of reflective pixels: grouping, cameras, images, and what their rays meet."""
