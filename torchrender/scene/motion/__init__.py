"""Moving scenes: nodes, animations, skins and morph targets."""
