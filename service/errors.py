"""Errors of the service, below the package's one exception tree."""

from __future__ import annotations

from torchrender.errors import InputError, TorchRenderError


class ServiceError(TorchRenderError):
    """A request cannot be served; carries what a problem document (RFC 9457) says about it."""

    def __init__(self, status: int, kind: str, detail: str, *, retry_after_s: float | None = None) -> None:
        self.status = status
        self.kind = kind
        self.detail = detail
        self.retry_after_s = retry_after_s
        super().__init__(detail)


class ProtocolError(InputError):
    """A message of the stream cannot be read; names the field and the limit.

    ``fatal``: it is no message of this protocol, so whatever follows cannot be trusted.
    """

    def __init__(self, reason: str, *, fatal: bool = False) -> None:
        self.fatal = fatal
        super().__init__(reason)


class CodecError(InputError):
    """Compressed depth or colour is damaged, cut off or of another size than announced."""
