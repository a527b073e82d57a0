"""Points of a walkthrough: how many, which belong together."""
