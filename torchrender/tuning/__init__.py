"""Measures what every setting costs and errs by, on this machine."""
