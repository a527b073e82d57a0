"""Faults written by hand, of the sorts that get past tests."""

from __future__ import annotations

from mutants.fault import Fault
from mutants.listed import effects, running, samples, seeing

FAULTS: tuple[Fault, ...] = (*seeing.FAULTS, *samples.FAULTS, *effects.FAULTS, *running.FAULTS)
