"""A client of the service: connect, send poses, receive depth images as tensors, reproject locally."""

from torchrender.client.session import StreamClosed, StreamError
from torchrender.client.stream import StreamClient, StreamedKeyframe

__all__ = ["StreamClient", "StreamClosed", "StreamError", "StreamedKeyframe"]
