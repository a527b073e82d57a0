"""What goes over the wire, for both sides: messages, compression, containers of keyframes. Needs extra ``client``."""

from torchrender.extras import check_extra

check_extra("client", "the stream of depth images")
