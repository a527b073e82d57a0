"""``python -m torchrender.report.points``."""

from torchrender.report.points.study import main

main()
