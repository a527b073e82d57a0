"""``python -m torchrender.report.stability``."""

from torchrender.report.stability.study import main

main()
