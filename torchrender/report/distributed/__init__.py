"""Batches and streams over several processes and replicas: measured, simulated, and reckoned for many machines."""
