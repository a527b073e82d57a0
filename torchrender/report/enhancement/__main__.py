"""``python -m torchrender.report.enhancement``."""

from torchrender.report.enhancement.study import main

main()
