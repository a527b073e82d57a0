"""``python -m torchrender.report.foundation``."""

from torchrender.report.foundation.study import main

main()
