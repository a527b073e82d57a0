"""The service: scenes, pictures and streams of depth images over REST and WebSocket. Needs the extra ``service``."""

from torchrender.extras import check_extra

check_extra("service", "the service")
