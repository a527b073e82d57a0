"""The service: scenes, pictures and streams of depth images over REST and WebSocket.

Importing this package needs nothing beyond the base installation; its modules need the extra ``service``.
"""
