"""``python -m torchrender.report.fog``."""

from torchrender.report.fog.study import main

main()
