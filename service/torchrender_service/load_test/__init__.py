"""Load and faults: measures the service as clients meet it, and writes a page with goals beside figures."""
