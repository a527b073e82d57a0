"""From visibility buffer and material table to radiance, in one pass over tiles that stay in the cache."""
