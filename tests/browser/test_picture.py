"""What the client shows: against the source picture and against the Python reprojection."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np
import pytest
from PIL import Image as PilImage

from browser_stage import Service, Visit, camera_of, grown, moved, pictures_of, psnr, reprojected
from browser_surface import drawn_exactly, page_image
from torchrender.client.mirrors import draw_with_mirrors
from torchrender.numerics.color import srgb_from_linear
from torchrender.wire.containers import KeyframeImage

DIRECTIONS = {"right": (1, 0, 0), "up": (0, -1, 0), "ahead": (0, 0, 1), "back and left": (-0.6, 0.5, -0.6)}


@pytest.fixture(scope="package")
def source(room: Visit) -> list[KeyframeImage]:
    """The layers that the room's page shows, as Python reads them, without what its mirrors show."""
    return [one for one in everything(room) if not one.header.mirrors]


def everything(room: Visit) -> list[KeyframeImage]:
    return pictures_of(room.layers(room.state("keyframes")[0]["id"]))


def typical_depth(source: list[KeyframeImage]) -> float:
    depth = source[0].depth
    return float(depth[depth.isfinite()].median())


def test_the_page_shows_the_scene(room: Visit) -> None:
    assert room.state("state") == "live"
    assert not room.problems
    shown, covered = room.capture()
    assert covered.all()
    assert shown.std(axis=(0, 1)).min() > 20, "the picture is nearly blank"
    assert room.state("stats")["holes"] == 0


def test_a_still_view_is_the_source_picture(room: Visit, source: list[KeyframeImage]) -> None:
    shown, covered = room.capture(earlier=False, layers=False, fill=False, mirrors=False, direct=False)
    height, width = shown.shape[:2]
    codes = source[0].codes.numpy()
    top, left = (codes.shape[0] - height) // 2, (codes.shape[1] - width) // 2
    picture = codes[top : top + height, left : left + width]
    assert covered.mean() > 0.999
    assert psnr(shown, picture, covered) >= 50.0
    with_all, _ = room.capture(fill=False, direct=False)
    assert psnr(with_all, picture, covered) >= 50.0, "other pictures only fill holes here"
    as_it_came, covered = room.capture()
    assert covered.all() and (as_it_came == picture).all()


def test_the_canvas_shows_what_is_captured(room: Visit) -> None:
    """Canvas and window have the same size here, so no scaling comes between; the page's controls are hidden."""
    hide = "shown => document.querySelectorAll('body > :not(main)').forEach(e => (e.style.display = shown))"
    room.page.evaluate(hide, "none")
    canvas = np.asarray(PilImage.open(BytesIO(room.page.locator("#stage").screenshot())).convert("RGB"))
    room.page.evaluate(hide, "")
    shown, covered = room.capture()
    assert psnr(canvas, shown, covered) >= 50.0


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_the_warp_agrees_with_the_python_reprojection(room: Visit, source: list[KeyframeImage], direction: str) -> None:
    step = 0.04 * typical_depth(source)
    view = moved(room.state("camera"), *(step * way for way in DIRECTIONS[direction]))
    shown, covered = room.capture(camera=view, earlier=False, layers=False, fill=False, mirrors=False)
    expected, valid = reprojected(source[:1], camera_of(view))
    assert (covered != valid).mean() < 0.01
    off_holes = ~grown(~(covered & valid))
    assert off_holes.mean() > 0.8
    assert psnr(shown, expected, off_holes) >= 40.0


def test_layers_agree_with_the_python_reprojection(room: Visit, source: list[KeyframeImage]) -> None:
    """Where surfaces of several images compete within a pixel the two may choose differently."""
    view = moved(room.state("camera"), 0.04 * typical_depth(source), 0.0, 0.0)
    shown, covered = room.capture(camera=view, earlier=False, fill=False, mirrors=False)
    expected, valid = reprojected(source, camera_of(view))
    assert (covered != valid).mean() < 0.01
    assert psnr(shown, expected, ~grown(~(covered & valid))) >= 36.0
    difference = np.abs(shown.astype(int) - expected).max(axis=-1)[covered & valid]
    assert (difference > 16).mean() < 0.02


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("layers", [0, 2])
def test_the_surfaces_are_those_of_python(
    room: Visit, source: list[KeyframeImage], layers: int, direction: str
) -> None:
    """Without the rounding of the browser's graphics."""
    messages = room.layers(room.state("keyframes")[0]["id"])
    images = [page_image(room.page, *pair) for pair in zip(messages, source, strict=False)][: layers + 1]
    step = 0.041 * typical_depth(source)
    view = camera_of(moved(room.state("camera"), *(step * way for way in DIRECTIONS[direction])))
    shown, covered = drawn_exactly(images, view)
    expected, valid = reprojected(source[: layers + 1], view)
    assert (covered != valid).mean() < 0.002
    assert psnr(shown, expected, ~grown(~(covered & valid))) >= 46.0


@pytest.mark.parametrize("share", [0.02, 0.05])
def test_layers_halve_the_holes(room: Visit, source: list[KeyframeImage], share: float) -> None:
    """A step to the right by this share of the typical depth."""
    view = moved(room.state("camera"), share * typical_depth(source), 0.0, 0.0)
    alone = 1 - room.capture(camera=view, earlier=False, layers=False, mirrors=False)[1].mean()
    layered = 1 - room.capture(camera=view, earlier=False, mirrors=False)[1].mean()
    assert alone > 0.003
    assert layered <= 0.5 * alone


def test_small_holes_are_filled_from_what_lies_behind(room: Visit, source: list[KeyframeImage]) -> None:
    view = moved(room.state("camera"), 0.03 * typical_depth(source), 0.0, 0.0)
    bare, covered = room.capture(camera=view, earlier=False, layers=False, fill=False, mirrors=False)
    filled, _ = room.capture(camera=view, earlier=False, layers=False, mirrors=False)
    truth, known = room.capture(camera=view, earlier=False, fill=False, mirrors=False)
    assert (filled[covered] == bare[covered]).all()
    holes = ~covered & known
    assert holes.sum() > 100
    assert psnr(filled, truth, holes) > psnr(bare, truth, holes) + 3.0


def turned(view: dict[str, Any], degrees: float) -> dict[str, Any]:
    """A camera of the page, turned to its right."""
    matrix = np.array(view["world_from_camera"]).reshape(4, 4)
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix[:3, :3] = matrix[:3, :3] @ [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]
    return view | {"world_from_camera": matrix.reshape(-1).tolist()}


def spread(picture: np.ndarray[Any, Any], covered: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """The covered pixels, drawn out sideways and up and down into holes, step by step."""
    out, known = picture.astype(float), covered.copy()
    while not known.all():
        padded, mask = np.pad(out, ((1, 1), (1, 1), (0, 0))), np.pad(known, 1).astype(float)[..., None]
        sums, counts = np.zeros_like(out), np.zeros((*known.shape, 1))
        for j, i in ((0, 1), (1, 0), (1, 2), (2, 1)):
            part = np.s_[j : j + known.shape[0], i : i + known.shape[1]]
            sums += padded[part] * mask[part]
            counts += mask[part]
        new = ~known & (counts[..., 0] > 0)
        out[new] = (sums / np.maximum(counts, 1))[new]
        known |= new
    return out.round().astype(np.uint8)


@pytest.mark.parametrize("degrees", [20.0, 40.0])
def test_a_turn_leaves_nothing_black(room: Visit, degrees: float) -> None:
    """As far as no keyframe has come yet: what lies beyond the picture is a calm continuation of it."""
    view = turned(room.state("camera"), degrees)
    options = {"camera": view, "earlier": False, "mirrors": False}
    bare, covered = room.capture(**options, fill=False)
    filled, also = room.capture(**options)
    assert (covered == also).all(), "what is filled still counts as holes"
    assert (~covered).mean() > 0.1, "a wide hole"
    assert (filled[covered] == bare[covered]).all()
    beside = grown(~covered, 40) & covered
    low, high = np.percentile(filled[beside], (1, 99), axis=0)
    assert (filled[~covered] >= low - 2).all() and (filled[~covered] <= high + 2).all()
    deep = ~grown(covered, 8)
    assert filled[deep].sum(-1).min() > 2 * bare[deep].sum(-1).max(), "nowhere nearly as dark as the backdrop"
    for axis in (0, 1):
        steps = np.abs(np.diff(filled.astype(int), axis=axis)).max(-1)
        inside = np.delete(deep, 0, axis)
        assert steps[inside].max() <= 8, "calm"


def test_wide_holes_are_filled_from_what_lies_behind(room: Visit, source: list[KeyframeImage]) -> None:
    """Better than by drawing out what is beside them, against the layer that knows what is there."""
    view = moved(room.state("camera"), 0.25 * typical_depth(source), 0.0, 0.0)
    options = {"camera": view, "earlier": False, "mirrors": False}
    bare, covered = room.capture(**options, layers=False, fill=False)
    filled, _ = room.capture(**options, layers=False)
    truth, known = room.capture(**options, fill=False)
    beside = np.logical_or.accumulate(covered[:, ::-1], axis=1)[:, ::-1]  # something is seen to their right
    holes = ~grown(covered, 1) & known & beside
    assert holes.sum() > 100
    assert psnr(filled, truth, holes) > psnr(bare, truth, holes) + 3.0
    assert psnr(filled, truth, holes) > psnr(spread(bare, covered), truth, holes) + 0.5


def test_what_no_picture_shows_is_the_backdrop(room: Visit) -> None:
    view = turned(room.state("camera"), 180.0)
    filled, covered = room.capture(camera=view, earlier=False, layers=False, mirrors=False)
    assert not covered.any()
    assert (filled == filled[0, 0]).all()


def test_mirrored_points_move_as_they_do_in_a_mirror(room: Visit, source: list[KeyframeImage]) -> None:
    """As Python draws them, which is far from a picture that is painted on the mirrors; the rest stays as it was."""
    mirrors = next(one for one in everything(room) if one.header.mirrors)
    view = moved(room.state("camera"), 0.04 * typical_depth(source), 0.0, 0.0)
    options = {"camera": view, "earlier": False, "layers": False, "fill": False}
    shown, covered = room.capture(**options)
    painted, also = room.capture(**options, mirrors=False)
    assert (covered == also).all()
    made = draw_with_mirrors(source[:1], mirrors, camera_of(view))
    expected = (srgb_from_linear(made.color[0].clamp(0, 1)) * 255).round().numpy().astype(np.uint8)
    moving = np.abs(expected.astype(int) - reprojected(source[:1], camera_of(view))[0]).max(axis=-1) > 8
    inside = ~grown(~(covered & made.valid[0].numpy()))
    assert (moving & inside).sum() > 300
    assert psnr(shown, expected, moving & inside) > psnr(painted, expected, moving & inside) + 6.0
    assert psnr(shown, expected, inside) >= 36.0
    assert psnr(shown, painted, inside & ~grown(moving, 3)) >= 45.0
    still, known = room.capture(earlier=False, layers=False, fill=False, direct=False)
    same, _ = room.capture(earlier=False, layers=False, fill=False, mirrors=False, direct=False)
    assert (still[known] == same[known]).all()


def test_everything_comes_from_the_server(room: Visit, service: Service) -> None:
    hosts = {url.split("/")[2] for url in room.requests if not url.startswith(("data:", "blob:"))}
    assert hosts == {f"127.0.0.1:{service.port}"}
