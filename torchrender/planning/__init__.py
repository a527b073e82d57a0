"""Which passes a picture calls for, with which settings, at what cost, and why."""
