"""``python -m torchrender.report.reuse``."""

from torchrender.report.reuse.study import main

main()
