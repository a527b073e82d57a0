"""What a renderer keeps for later, and how much of it."""
