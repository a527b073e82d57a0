"""``python -m torchrender.report.shadow_maps``."""

from torchrender.report.shadow_maps.study import main

main()
