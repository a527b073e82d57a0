"""``python -m torchrender.cli``."""

import sys

from torchrender.cli.main import main

sys.exit(main())
