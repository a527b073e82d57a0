"""``python -m torchrender.report.style``."""

from torchrender.report.style.study import main

main()
