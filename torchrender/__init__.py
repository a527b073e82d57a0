"""torchrender: complex scenes approximated by depth images, every effect computed in image space on those."""

__version__ = "0.1.0"
