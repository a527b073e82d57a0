"""``python -m torchrender.report.unseen``."""

from torchrender.report.unseen.study import main

if __name__ == "__main__":
    main()
