"""``python -m torchrender.report.scattering``."""

from torchrender.report.scattering.study import main

main()
