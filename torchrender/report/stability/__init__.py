"""Every pass over every hard case."""
