"""Loops of walkthroughs: comparing photos, resampling and filling textures, drawing planes and points."""
