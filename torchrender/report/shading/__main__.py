"""``python -m torchrender.report.shading``."""

from torchrender.report.shading.study import main

main()
