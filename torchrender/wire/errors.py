"""What can be wrong with a message, below the package's one exception tree."""

from __future__ import annotations

from torchrender.errors import InputError


class ProtocolError(InputError):
    """A message of the stream cannot be read; names the field and the limit.

    ``fatal``: it is no message of this protocol, so whatever follows cannot be trusted.
    """

    def __init__(self, reason: str, *, fatal: bool = False) -> None:
        self.fatal = fatal
        super().__init__(reason)


class CodecError(InputError):
    """Compressed depth or colour is damaged, cut off or of another size than announced."""
