"""How well time budgets are kept."""
