"""Photos with depth: reading them, and repairing their poses and exposure."""
