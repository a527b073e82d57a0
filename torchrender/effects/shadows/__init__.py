"""Which light reaches what: shadow maps, sampled area lights, rays."""
