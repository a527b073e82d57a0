"""``python -m torchrender.report.fuzz``."""

from torchrender.report.fuzz.study import main

if __name__ == "__main__":
    raise SystemExit(main())
