"""How good a walkthrough is, and where the next photo should be taken."""
