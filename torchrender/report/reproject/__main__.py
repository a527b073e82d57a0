"""``python -m torchrender.report.reproject``."""

from torchrender.report.reproject.study import main

main()
