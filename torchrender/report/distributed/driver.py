"""A batch in a process of its own, to be killed."""

import sys

from torchrender.report.distributed.batches import drive

if __name__ == "__main__":
    drive(sys.argv[1:])
