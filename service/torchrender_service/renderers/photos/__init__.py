"""Photos that clients send."""
