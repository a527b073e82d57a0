"""From what pixels see to the light that they send: materials, lights, lobes, the sky; in torch and compiled."""
