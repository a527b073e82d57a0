"""``python -m torchrender``: the program ``torchrender``."""

from torchrender.cli.__main__ import run

if __name__ == "__main__":
    run()
