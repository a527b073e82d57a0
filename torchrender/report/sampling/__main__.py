"""``python -m torchrender.report.sampling``."""

from torchrender.report.sampling.study import main

main()
