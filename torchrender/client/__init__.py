"""A client of the service: connect, send poses, receive depth images as tensors, reproject locally.

Needs the extra ``client``.
"""

from torchrender.extras import check_extra

check_extra("client", "the client of the service")

from torchrender.client.session import StreamClosed, StreamError  # noqa: E402
from torchrender.client.stream import StreamClient, StreamedKeyframe  # noqa: E402

__all__ = ["StreamClient", "StreamClosed", "StreamError", "StreamedKeyframe"]
