"""The rasteriser, rays and the first picture, beside others."""
