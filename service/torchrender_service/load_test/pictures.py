"""Codecs, the unmoved view, and holes: measured in this process, without a server."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.reconstruct.reproject import reproject
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender.wire.cameras import cameras_of, header_of
from torchrender.wire.codec import decode_color, decode_depth, display_bytes, encode_color, encode_depth
from torchrender.wire.containers import KeyframeImage, depth_images_of, read_container
from torchrender_service.load_test.rows import Effort, Row
from torchrender_service.renderers.engine import render_image
from torchrender_service.renderers.jobs import Bounds
from torchrender_service.renderers.keyframes import Stamp, enough_bits, first_message, layer_message
from torchrender_service.renderers.streaming.layers import cameras_around, extra_layers, typical_depth

BASELINES = (0.03, 0.06, 0.12)  # in median depths
SCENES = ("living_room", "washroom", "city", "nest", "tree", "cornell_box")
BORDER = 0.15  # share of each side that is left out when holes are counted: overscan covers it


def codec_rows(effort: Effort) -> list[Row]:
    """Time and size of a 720p keyframe."""
    scene = load(effort.scene)
    camera = scene.camera(width=1280, height=720)
    image, _ = render_image(scene, camera, Bounds(), RenderOptions(reflections="environment"))
    depth, radiance = image.gbuffer.depth[0], image.radiance[0]
    codes = display_bytes(radiance)
    bits = enough_bits(header_of(camera).fx, float(depth.min()), typical_depth(depth))
    encoded, jpeg = encode_depth(depth, bits=bits), encode_color(codes, "jpeg", quality=85)
    size = {"width": 1280, "height": 720}
    depth_ms = _median_ms(lambda: encode_depth(depth, bits=bits))
    display_ms = _median_ms(lambda: display_bytes(radiance))
    color_ms = _median_ms(lambda: encode_color(codes, "jpeg", quality=85))
    total = depth_ms + display_ms + color_ms
    decode_ms = _median_ms(lambda: decode_depth(encoded.data, bits=bits, near=encoded.near, **size))
    decode_ms += _median_ms(lambda: decode_color(jpeg, "jpeg", **size))
    kilobytes = (len(encoded.data) + len(jpeg)) / 1000
    parts = f"depth {depth_ms:.1f}, to sRGB {display_ms:.1f}, JPEG {color_ms:.1f}"
    return [
        Row(
            what=f"encode 720p colour and depth, one core ({effort.scene})",
            goal="≤ 10 ms",
            measured=f"{total:.1f} ms ({parts})",
            met=total <= 10.0,
            details={"depth_ms": depth_ms, "display_ms": display_ms, "color_ms": color_ms},
        ),
        Row(
            what=f"the keyframe, {bits} bits of depth while moving",
            goal="≤ 300 KB",
            measured=f"{kilobytes:.0f} KB (depth {len(encoded.data) / 1000:.0f}, colour {len(jpeg) / 1000:.0f})",
            met=kilobytes <= 300,
        ),
        Row(what="decode it, one core", goal="≤ 15 ms", measured=f"{decode_ms:.1f} ms", met=decode_ms <= 15.0),
    ]


def view_rows(effort: Effort) -> list[Row]:
    """The unmoved view against the source picture, and holes with and without extra layers."""
    rows = []
    for name in ("cornell_box",) if effort.quick else SCENES:
        scene = load(name)
        camera = scene.camera(width=effort.size[0], height=effort.size[1])
        images = _keyframe(scene, camera)
        psnr = _psnr(images[0])
        rows.append(
            Row(
                what=f"unmoved view against the source picture, {name} (Python client)",
                goal="≥ 50 dB",
                measured="no difference" if psnr == np.inf else f"{psnr:.1f} dB",
                met=psnr >= 50.0,
            )
        )
        rows += [_holes(name, images, share) for share in BASELINES]
    return rows


def _keyframe(scene: Scene, camera: Cameras) -> list[KeyframeImage]:
    """A keyframe with two extra layers, without loss."""
    options = RenderOptions(reflections="off")
    image, _ = render_image(scene, camera, Bounds(), options, RenderHistory())
    assert image.history is not None
    depth = image.gbuffer.depth[0]
    around = cameras_around(camera, depth, 2)
    layers = extra_layers(image.scene, image.gbuffer, around, options, image.history)
    stamp = Stamp(id=0, layers=1 + len(layers), color="webp", quality=100)
    messages = [first_message(stamp, camera, depth, image.radiance[0], render_ms=0.0, plan=None)]
    messages += [layer_message(stamp, k + 1, layer, render_ms=0.0) for k, layer in enumerate(layers)]
    return read_container(b"".join(messages), max_pixels=2**24, max_images=8)


def _psnr(image: KeyframeImage) -> float:
    made = reproject(depth_images_of([image]), image.camera)
    valid = made.valid[0].numpy()
    error = display_bytes(made.color[0]).astype(float) - image.codes.numpy()
    mean = float((error[valid] ** 2).mean()) if valid.any() else np.nan
    return float(np.inf) if mean == 0.0 else float(10.0 * np.log10(255.0**2 / mean))


def _holes(name: str, images: list[KeyframeImage], share: float) -> Row:
    """Mean over steps to both sides, in the middle of the view."""
    depth = images[0].depth
    step = share * typical_depth(depth)
    alone, together = [], []
    for sign in (-1.0, 1.0):
        view = _aside(images[0].camera, sign * step)
        alone.append(float((~reproject(depth_images_of(images[:1]), view).valid).float().mean()))
        together.append(float((~reproject(depth_images_of(images), view).valid).float().mean()))
    before, after = statistics.mean(alone), statistics.mean(together)
    return Row(
        what=f"holes, {name}, a step aside of {share:g} median depths",
        goal="halved by extra layers",
        measured=f"{100 * before:.2f} % without, {100 * after:.2f} % with two extra layers",
        met=after <= 0.5 * before if before > 1e-4 else None,
        details={"without": before, "with": after},
    )


def _aside(camera: Cameras, x: float) -> Cameras:
    camera = cameras_of(header_of(camera))
    matrix = camera.camera_from_world.clone()
    matrix[:, 0, 3] -= x
    left, top = int(BORDER * camera.width), int(BORDER * camera.height)
    moved = replace(camera, camera_from_world=matrix)
    return moved.sub_camera(left, top, camera.width - 2 * left, camera.height - 2 * top)


def _median_ms(work: Callable[[], object], runs: int = 15) -> float:
    times = []
    for _ in range(runs + 2):
        begin = time.perf_counter()
        work()
        times.append(1e3 * (time.perf_counter() - begin))
    return statistics.median(times[2:])
