"""The processes that render, what they are asked for, and what they keep."""
