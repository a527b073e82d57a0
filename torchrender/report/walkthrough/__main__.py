"""``python -m torchrender.report.walkthrough``."""

from torchrender.report.walkthrough.study import main

main()
