"""What reflectors show."""
