"""``python -m torchrender.report.dataset``."""

from torchrender.report.dataset.study import main

main()
