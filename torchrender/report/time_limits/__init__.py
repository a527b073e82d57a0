"""Who keeps a time limit, and with what picture."""
