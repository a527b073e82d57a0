"""Errors of the service, below the package's one exception tree."""

from __future__ import annotations

from typing import Any

from torchrender.errors import TorchRenderError


class ServiceError(TorchRenderError):
    """A request cannot be served; carries what a problem document (RFC 9457) says about it."""

    def __init__(self, status: int, kind: str, detail: str, *, retry_after_s: float | None = None) -> None:
        self.status = status
        self.kind = kind
        self.detail = detail
        self.retry_after_s = retry_after_s
        super().__init__(detail)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.status, self.kind, self.detail), {"retry_after_s": self.retry_after_s}


def out_of_memory(error: Exception) -> bool:
    """Whether there was no memory left; torch says so in words."""
    return isinstance(error, MemoryError) or "allocate memory" in str(error)
