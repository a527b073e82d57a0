"""Gradient-enhanced pictures beside what else makes shape readable."""
