"""The application: routes, limits, settings, logs and metrics."""
