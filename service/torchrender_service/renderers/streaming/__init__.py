"""Keyframes of streams: what a session shows next, out of new light and light that is known."""
