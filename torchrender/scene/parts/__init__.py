"""What scenes check of their parts, and find out about them."""
