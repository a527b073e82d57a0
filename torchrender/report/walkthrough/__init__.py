"""Walkthroughs from RGB-D photos, against their source, its baselines and what else people use."""
