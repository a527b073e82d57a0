"""Pictures of every scene on one sheet."""
