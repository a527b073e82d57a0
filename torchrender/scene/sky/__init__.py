"""Light from everywhere, filtered for surfaces: irradiance, mirrored light by roughness, the sun apart."""
