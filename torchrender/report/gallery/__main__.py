"""``python -m torchrender.report.gallery``."""

from torchrender.report.gallery.study import main

main()
