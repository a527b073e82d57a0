"""What drawing walkthroughs keeps from picture to picture."""
