"""A picture in the making: its options, its buffers, and what it hands to the next one."""
