"""One fault: a text in a file, what stands there instead, and the tests that should notice."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Seeded by replacing a text that occurs once in its file."""

    area: str
    file: str  # from the repository's root
    old: str
    new: str
    tests: str  # arguments of pytest, separated by blanks; -k and its expression last

    @property
    def key(self) -> str:
        """The same from run to run."""
        told = "\0".join((self.file, self.old, self.new, self.tests))
        return hashlib.sha256(told.encode()).hexdigest()[:12]

    @property
    def title(self) -> str:
        """In a line."""
        was, now = (" ".join(text.split()) for text in (self.old, self.new))
        return f"{self.file}: {was}  ->  {now or '(nothing)'}"

    def seeded(self, root: Path) -> str:
        """The file's text with the fault.

        Raises:
            ValueError: the text does not stand there exactly once, so the list is older than the file.
        """
        text = (root / self.file).read_text()
        if text.count(self.old) != 1:
            raise ValueError(f"{self.file}: {self.old!r} stands there {text.count(self.old)} times")
        return text.replace(self.old, self.new)


def faults(area: str, file: str, tests: str, *changes: tuple[str, str]) -> list[Fault]:
    """Several of one file."""
    return [Fault(area=area, file=file, old=old, new=new, tests=tests) for old, new in changes]
