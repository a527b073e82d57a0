"""``python -m torchrender.report.soft_shadows``."""

from torchrender.report.soft_shadows.study import main

main()
