"""The command line of what is fitted once and shipped: a table in a file of NumPy."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from torchrender.images.files import write_atomically


def write_fitted(description: str | None, shipped: Path, fit: Callable[[], np.ndarray]) -> None:
    """Fit a table and write it where the package has it, or to what ``-o`` names."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=shipped, help="file to write")
    path = parser.parse_args().output
    table = fit()

    def write(target: Path) -> None:
        with target.open("wb") as file:
            np.save(file, table)

    write_atomically(path, write)
    sys.stdout.write(f"{path}\n")
