"""``python -m torchrender.report.voxels``."""

from torchrender.report.voxels.study import main

main()
