"""``python -m torchrender.report.reflections``."""

from torchrender.report.reflections.study import main

main()
