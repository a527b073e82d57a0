"""``python -m torchrender.report.time_limits``."""

from torchrender.report.time_limits.study import main

main()
