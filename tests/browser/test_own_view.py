"""Where a picture was taken it is shown as it came, without a warp: that of a changed scene is there the sooner."""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

import torchrender as tr
from browser_stage import JPEG_READY, Visit, pictures_of, psnr, run_script
from torchrender.numerics.color import srgb_from_linear
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import header_of
from torchrender_service.renderers.keyframes import Stamp, first_message, layer_message
from torchrender_service.renderers.streaming.layers import Layer

SIZE = (96, 64)
MARGIN = (9, 6)
SCRIPT = """
    const { Decoder } = await import("/js/decoder.js");
    const { Warp } = await import("/js/warp.js");
    const decoder = new Decoder();
    const warp = new Warp(document.createElement("canvas"));
    const { view, options } = given;
    warp.resize(view.width, view.height);
    const picture = warp.add(await decoder.decode(bytes(given.message).buffer, 1e8));
    decoder.worker.terminate();
    warp.warp([picture], view, 0.01, options);
    warp.finish();
    const { triangles } = warp.renderer.info.render;
    const { holes } = await warp.holeShare();
    return [triangles, holes, text(warp.capture(false))];
"""


def camera() -> Cameras:
    """Of the picture, with a margin around the view."""
    size = {"width": SIZE[0] + 2 * MARGIN[0], "height": SIZE[1] + 2 * MARGIN[1]}
    return tr.Cameras.look_at((1.0, 2.0, -3.0), (0.2, 0.1, 0.3), fov_deg=50.0, near=0.01, **size)


def own_view() -> Cameras:
    return camera().sub_camera(*MARGIN, *SIZE)


def light() -> torch.Tensor:
    """(H,W,3) linear: every pixel has another colour than those beside it."""
    made = camera()
    return torch.rand(made.height, made.width, 3, generator=torch.Generator().manual_seed(5))


def picture(**stamp: Any) -> bytes:
    """Of things 1 to 2 away, next to each other as it comes."""
    made = camera()
    depth = 1.0 + torch.rand(made.height, made.width, generator=torch.Generator().manual_seed(3))
    known = Stamp(id=0, layers=1, color="webp", quality=100, **stamp)
    return first_message(known, made, depth, light(), render_ms=0.0, plan=None)


def drawn(page: Visit, message: bytes, view: Cameras, **options: Any) -> tuple[int, float, np.ndarray[Any, Any]]:
    """Triangles that are drawn, the share of holes, and the picture (H,W,3) uint8."""
    header = header_of(view)
    fields = {name: getattr(header, name) for name in header.__struct_fields__}
    packed = base64.b64encode(message).decode()
    triangles, holes, text = run_script(page.page, SCRIPT, message=packed, view=fields, options=options)
    pixels = np.frombuffer(base64.b64decode(text), np.uint8).reshape(view.height, view.width, 4)
    return triangles, holes, pixels[..., :3]


def codes() -> np.ndarray[Any, Any]:
    """(H,W,3) uint8 what of the picture the view shows."""
    (left, top), (width, height) = MARGIN, SIZE
    display = pictures_of([picture()])[0].codes.numpy()
    return display[top : top + height, left : left + width]


@pytest.fixture
def page(visit: Callable[..., Visit]) -> Visit:
    made = visit(layers=0)
    made.wait(JPEG_READY)
    return made


def test_a_picture_is_shown_as_it_came_where_it_was_taken(page: Visit) -> None:
    triangles, holes, shown = drawn(page, picture(), own_view())
    assert (triangles, holes) == (1, 0.0), "one triangle over all pixels: no sample is drawn by itself"
    assert (shown == codes()).all()


def test_its_exposure_is_that_of_the_warp(page: Visit) -> None:
    triangles, _, shown = drawn(page, picture(), own_view(), exposure=-1.0)
    assert triangles == 1
    display = 255.0 * srgb_from_linear(torch.from_numpy(linear(codes())) * 0.5)
    assert np.abs(shown - display.numpy()).max() < 1.0
    warped = drawn(page, picture(), own_view(), exposure=-1.0, direct=False)
    assert warped[0] > 1 and psnr(shown, warped[2], np.ones(shown.shape[:2], dtype=bool)) > 50.0


def linear(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Light of display codes."""
    c = values / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("change", ["aside", "turned", "wider", "shape"])
def test_any_other_view_is_warped(page: Visit, change: str) -> None:
    made, options = own_view(), {"enhance": 0.5} if change == "shape" else {}
    if change in ("aside", "turned"):
        moved = made.camera_from_world.clone()
        if change == "aside":
            moved[0, 0, 3] -= 0.1 / float(made.intrinsics[0, 0, 0])  # a tenth of a pixel of what is nearest
        else:
            angle = 0.1 / float(made.intrinsics[0, 0, 0])
            turn = torch.eye(4, dtype=moved.dtype)
            turn[0, 0], turn[0, 2], turn[2, 0], turn[2, 2] = np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)
            moved = turn @ moved
        made = Cameras(
            camera_from_world=moved, intrinsics=made.intrinsics, width=made.width, height=made.height, near=made.near
        )
    elif change == "wider":
        made = camera().sub_camera(-2, 0, camera().width, camera().height)
    assert drawn(page, picture(), made, **options)[0] > 100


def test_an_extra_layer_is_warped_even_there(page: Visit) -> None:
    made = camera()
    known = torch.rand(made.height, made.width, generator=torch.Generator().manual_seed(2)) < 0.5
    layer = Layer(made, torch.full((made.height, made.width), 2.0), light(), known)
    message = layer_message(Stamp(id=0, layers=2, color="webp"), 1, layer, render_ms=0.0)
    triangles, holes, _ = drawn(page, message, own_view())
    assert triangles > 100 and holes > 0.2


def test_a_small_picture_is_spread_over_the_view(page: Visit) -> None:
    whole = camera().scaled(2.0)
    triangles, holes, shown = drawn(page, picture(), whole)
    assert (triangles, holes) == (1, 0.0)
    display = torch.from_numpy(pictures_of([picture()])[0].codes.numpy()).float()
    spread = torch.nn.functional.interpolate(display.permute(2, 0, 1)[None], scale_factor=2, mode="bilinear")[0]
    expected = spread.permute(1, 2, 0).numpy()
    assert np.abs(shown - expected).max() <= 2.0
