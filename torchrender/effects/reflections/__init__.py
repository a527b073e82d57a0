"""What mirrors show: traced, by clustered depth images, or out of an earlier picture."""
