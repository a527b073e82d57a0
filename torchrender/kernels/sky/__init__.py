"""Light from everywhere, summed over parts of the sky."""
