"""Scenes that clients bring: uploads, and where they are kept."""
