"""What viewers ask of a renderer beside keyframes: exposure and effects, cameras and obstacles, what a pixel shows."""
