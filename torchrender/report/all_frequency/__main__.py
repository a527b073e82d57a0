"""``python -m torchrender.report.all_frequency``."""

from torchrender.report.all_frequency.study import main

main()
