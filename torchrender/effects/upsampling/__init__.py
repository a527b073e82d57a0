"""Pictures at more pixels than were shaded."""
