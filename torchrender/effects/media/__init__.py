"""Light that media scatter once towards the eye, and how much of what lies behind them they let through."""
