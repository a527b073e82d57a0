"""Light that media scatter towards the eye."""
