"""Pictures, depth images and reprojections that single requests ask for."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.depth.options import SamplingOptions
from torchrender.depth.sample import sample_depth_images
from torchrender.depth.viewpoints import viewpoints_around
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.image import Image, camera_arrays
from torchrender.images.files import png_bytes, write_npz
from torchrender.pipeline.options import RenderOptions, shadow_choices
from torchrender.raster import surface_attributes
from torchrender.reconstruct.reproject import Reprojection, reproject
from torchrender.renderer import shade_samples
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.wire.codec import display_bytes
from torchrender.wire.containers import depth_images_of, read_container
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.engine import render_image
from torchrender_service.renderers.jobs import CheckKeyframes, DepthImages, Render, Reproject
from torchrender_service.renderers.keeping.lasting import LastingParts
from torchrender_service.renderers.keyframes import Stamp, first_message, layer_message
from torchrender_service.renderers.streaming.layers import Layer
from torchrender_service.renderers.views import camera_of_view


def render_picture(scene: Scene, job: Render, lasting: LastingParts) -> dict[str, Any]:
    """A picture as the bytes of a file, with its plan and times. What it shares with others of its scene is used again,
    and so is how long they took: a budget is kept from the second picture on."""
    options = _options(job.options)
    use = ("request", job.view.width, job.view.height, options.supersample)
    past = replace(lasting.get(job.scene.id, use), sequence=False)
    image, plan = render_image(scene, camera_of_view(scene, job.view), job.bounds, options, past)
    assert image.history is not None
    lasting.put(job.scene.id, use, image.history, whole=True)
    return {"file": _picture_file(image, job), "plan": plan, "timings_ms": dict(image.timings_ms)}


def _options(asked: Mapping[str, Any]) -> RenderOptions:
    """Options of a request: those of shadows have names of their own there, enhancement is plain values."""
    rest = dict(asked)
    shadows = rest.pop("shadows", True)
    way = shadows if isinstance(shadows, str) else None if shadows else "off"
    wish = rest.pop("enhance", None)
    return RenderOptions(
        **shadow_choices(way, rest.pop("shadow_size", None), rest.pop("cascades", None)),
        enhance=None if wish is None else EnhanceOptions(**wish),
        **rest,
    )


def _picture_file(image: Image, job: Render) -> bytes:
    if job.format == "png":
        return png_bytes(image.displayed()[0])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"picture.{job.format}"
        if job.format == "npz" and job.buffers:
            arrays: dict[str, Tensor] = {
                n: image.radiance if n == "radiance" else getattr(image.gbuffer, n) for n in job.buffers
            }
            write_npz(path, {**arrays, **camera_arrays(image.cameras)})
        else:
            image.save(path)
        return path.read_bytes()


def make_container(scene: Scene, job: DepthImages) -> dict[str, Any]:
    """Depth images of several cameras, as keyframe messages one after the other.

    Image 0 is layer 0. The others say with their mask where they hold a sample; conventional images hold the sky, too.
    """
    cameras = _cameras(scene, job)
    options = SamplingOptions(method=job.method, pixel_test="depth_identity", cull_backfaces=False, count_layers=False)
    images = sample_depth_images(scene, cameras, options)
    radiance = shade_samples(scene, surface_attributes(scene, images), _options(job.options))
    stamp = Stamp(id=0, layers=len(images), still=True, bits=job.bits, color=job.color, quality=job.quality)
    messages = []
    for k in range(len(images)):
        camera, depth = images.cameras[k], images.depth[k]
        known = images.covered[k] | (job.method == "conventional")
        if k == 0:
            messages.append(first_message(stamp, camera, depth, radiance[k], render_ms=0.0, plan=None))
        else:
            messages.append(layer_message(stamp, k, Layer(camera, depth, radiance[k], known), render_ms=0.0))
    return {"container": b"".join(messages), "images": len(images)}


def _cameras(scene: Scene, job: DepthImages) -> Cameras:
    cameras = Cameras.cat([camera_of_view(scene, view) for view in job.views])
    if cameras.orthographic:
        raise ServiceError(422, "invalid-value", "depth images need perspective cameras")
    return viewpoints_around(scene, cameras, job.around, spread=job.spread) if job.around > 1 else cameras


def check_keyframes(job: CheckKeyframes) -> dict[str, Any]:
    """Whether a container can be reprojected: all of it is decoded, as :func:`reproject_picture` does.

    Raises:
        ProtocolError: no container, cut off, more or larger pictures than allowed, or of several sizes.
        CodecError: damaged pictures. CameraError: a camera that is not usable.
    """
    images = read_container(job.container, max_pixels=job.max_pixels, max_images=job.max_images)
    return {"images": len(depth_images_of(images))}


def reproject_picture(job: Reproject) -> dict[str, Any]:
    """The view of another camera as the bytes of a file; transparent, or not ``valid``, where no sample reaches."""
    images = read_container(job.container, max_pixels=job.max_pixels, max_images=job.max_images)
    assert job.view.pose is not None or job.view.look_at is not None
    camera = camera_of_view(Scene(), job.view)
    made = reproject(depth_images_of(images), camera, method=job.method)
    return {"file": _reprojected_file(made, job.format), "valid_share": float(made.valid.float().mean())}


def _reprojected_file(made: Reprojection, kind: str) -> bytes:
    if kind == "png":
        return png_bytes(torch.cat([made.color[0], made.valid[0, ..., None].float()], dim=-1))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"picture.{kind}"
        arrays: dict[str, Tensor] = {
            "color": made.color,
            "srgb": torch.from_numpy(display_bytes(made.color[0]))[None],
            "depth": made.depth,
            "valid": made.valid,
            "source": made.source,
        }
        write_npz(path, {**arrays, **camera_arrays(made.cameras)})
        return path.read_bytes()
