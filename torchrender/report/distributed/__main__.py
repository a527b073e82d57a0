"""``python -m torchrender.report.distributed``."""

from torchrender.report.distributed.study import main

main()
