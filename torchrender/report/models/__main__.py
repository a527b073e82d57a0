"""Run the study."""

from torchrender.report.models.study import main

main()
