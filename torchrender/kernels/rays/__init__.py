"""Compiled loops of ray casting and of marches through depth images."""
