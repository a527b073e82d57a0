"""``python -m torchrender.report.planning``."""

from torchrender.report.planning.study import main

main()
