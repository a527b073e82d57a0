"""Sets of depth images: one door to conventional, depth-peeled and non-redundant sampling (specification 01)."""

from __future__ import annotations

from torchrender.arrays import in_single_precision
from torchrender.buffers import DepthImages, check_fixed_buffers
from torchrender.checks import check_class, options_of
from torchrender.depth.conventional import conventional
from torchrender.depth.nonredundant import pixel_nonredundant
from torchrender.depth.nonredundant_rays import visibility_nonredundant
from torchrender.depth.options import SamplingOptions
from torchrender.depth.peeling import central_camera, peel
from torchrender.depth.samples import Samples, depth_images
from torchrender.errors import InputError
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene, resized
from torchrender.scene.triangles import check_fixed


@in_single_precision
def sample_depth_images(scene: Scene, cameras: Cameras, options: SamplingOptions | None = None) -> DepthImages:
    """Depth images of ``scene`` from the viewpoints of ``cameras``.

    - "conventional": the nearest surface in every pixel of each camera.
    - "nonredundant": image i holds in every pixel the nearest surface that none of the images 0..i-1 has. The order of
      the cameras matters; image 0 is the conventional image.
    - "depth_peeling": ``options.layers`` images (default: as many as there are cameras), all from
      :func:`central_camera`; image l holds the l-th surface behind every pixel.

    Args:
        cameras: B perspective cameras.

    Raises:
        InputError: orthographic cameras, or none at all. GradientError: a mesh asks for a gradient.
    """
    check_class("scene", scene, Scene)
    check_class("cameras", cameras, Cameras)
    options = options_of(options, SamplingOptions)
    check_fixed("sample_depth_images", scene)
    if cameras.orthographic or not len(cameras):
        got = "orthographic ones" if cameras.orthographic else "none"
        raise InputError(f"cameras must be perspective and at least one, got {got}")
    if options.size is not None:
        cameras = resized(cameras, *options.size)
    if options.method == "depth_peeling":
        layers = len(cameras) if options.layers is None else options.layers
        cameras = central_camera(cameras)[[0] * layers]
    return depth_images(scene, _samples(scene, cameras, None, options), options)


def sample_offset_images(scene: Scene, images: DepthImages) -> DepthImages:
    """The same views half a pixel further: pixel centres at the corners of the pixels of ``images``.

    The result has (H+1) x (W+1) pixels; pixel (row j, column i) looks through the upper left corner of that pixel.
    Offset image i is sampled with the redundancy of image i: against ``images`` 0..i-1, not against other offset
    images. For depth peeling, image l holds layer l as seen through those corners.

    Args:
        images: what :func:`sample_depth_images` made of the same scene.
    """
    check_class("scene", scene, Scene)
    check_class("images", images, DepthImages)
    check_fixed_buffers("sample_offset_images", "images", images)
    options = SamplingOptions(**images.parameters)
    own = images.cameras
    cameras = own.sub_camera(-0.5, -0.5, own.width + 1, own.height + 1)
    return depth_images(scene, _samples(scene, cameras, images, options), options)


def _samples(scene: Scene, cameras: Cameras, images: DepthImages | None, options: SamplingOptions) -> Samples:
    """What ``cameras`` sample; redundancy is against ``images``, by default those that the cameras themselves take."""
    if options.method == "conventional":
        return conventional(scene.geometry, cameras, options)
    if options.method == "depth_peeling":
        return peel(scene, cameras, options)
    if options.redundancy == "visibility":
        return visibility_nonredundant(scene, cameras, None if images is None else images.cameras, options)
    return pixel_nonredundant(scene, cameras, images, options)
