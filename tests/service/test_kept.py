"""What is kept for later requests: how much of it, what goes first, and what a container may declare."""

from __future__ import annotations

import asyncio

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.scene.camera import Cameras
from torchrender.wire.errors import ProtocolError
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.keyframes import Stamp, first_message
from torchrender_service.web.kept import KeptContainers, count_keyframes


@given(st.lists(st.tuples(st.integers(0, 7), st.booleans()), max_size=40), st.integers(1, 20))
@settings(deadline=None)
def test_containers_are_a_queue_of_so_many_bytes(asked: list[tuple[int, bool]], limit: int) -> None:
    """Beside a list: what was used last stays, as far as it has room."""
    asyncio.run(_beside_a_list(asked, limit))


async def _beside_a_list(asked: list[tuple[int, bool]], limit: int) -> None:
    kept = KeptContainers(limit)
    known: list[int] = []
    for number, put in asked:
        data = bytes([number]) * (number + 1)
        if put:
            await kept.put(data, str(number))
        elif number in known:
            assert await kept.get(str(number)) == data
        else:
            with pytest.raises(ServiceError):
                await kept.get(str(number))
            continue
        known = [other for other in known if other != number] + [number]
        while sum(other + 1 for other in known) > limit:
            known.pop(0)
        assert [other for other in range(8) if await kept.has(str(other))] == sorted(known)


def test_a_container_declares_as_many_pictures_and_pixels_as_are_allowed_and_no_more() -> None:
    camera = Cameras.look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), width=6, height=4)
    depth, light = torch.full((4, 6), 2.0), torch.zeros(4, 6, 3)
    one = first_message(Stamp(id=1, layers=1), camera, depth, light, render_ms=1.0, plan=None)
    for count in (1, 3):
        assert count_keyframes(one * count, max_pixels=24, max_images=3) == count
    for data, pixels in ((one * 4, 24), (one, 23), (b"", 24), (one[:-1], 24)):
        with pytest.raises(ProtocolError):
            count_keyframes(data, max_pixels=pixels, max_images=3)
