"""What the picture sees, and what rays and lights need to see."""
