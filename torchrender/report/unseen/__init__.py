"""Predicted errors, error bounds and budgets on scenes that calibration never saw."""
