"""``python -m torchrender.report.budget``."""

from torchrender.report.budget.study import main

main()
