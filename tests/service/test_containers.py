"""Keyframe messages as depth images, and the extra layers in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from torchrender.errors import CameraError
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility
from torchrender.reconstruct.reproject import reproject
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.wire.cameras import cameras_of, header_of
from torchrender.wire.codec import display_bytes
from torchrender.wire.containers import KeyframeImage, depth_images_of, plane_normals, read_container
from torchrender.wire.errors import CodecError, ProtocolError
from torchrender.wire.messages import CameraHeader, decode
from torchrender_service.renderers.engine import render_image
from torchrender_service.renderers.jobs import Bounds, DepthImages, SceneSource, View
from torchrender_service.renderers.keyframes import Stamp, first_message, layer_message
from torchrender_service.renderers.pictures import make_container
from torchrender_service.renderers.streaming.layers import cameras_around, extra_layers

SIZE = (64, 48)
PLAIN = RenderOptions(reflections="off")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load("cornell_box")


def keyframe(scene: Scene, camera: Cameras, count: int, **stamp) -> list[bytes]:
    """The messages of a keyframe, without loss."""
    image, _ = render_image(scene, camera, Bounds(), PLAIN, RenderHistory())
    assert image.history is not None
    around = cameras_around(camera, image.gbuffer.depth[0], count)
    layers = extra_layers(image.scene, image.gbuffer, around, PLAIN, image.history)
    mark = Stamp(id=5, layers=1 + count, color="webp", quality=100, **stamp)
    first = first_message(mark, camera, image.gbuffer.depth[0], image.radiance[0], render_ms=1.0, plan=None)
    return [first, *(layer_message(mark, k + 1, layer, render_ms=1.0) for k, layer in enumerate(layers))]


def square(side: float, z: float, material: int) -> Mesh:
    """Facing +z."""
    h = side / 2
    corners = torch.tensor([[-h, -h, z], [h, -h, z], [h, h, z], [-h, h, z]])
    return Mesh(vertices=corners, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), material=material)


def read(messages: list[bytes]):
    return read_container(b"".join(messages), max_pixels=10**5, max_images=8)


def aside(camera: Cameras, x: float) -> Cameras:
    camera = cameras_of(header_of(camera))
    matrix = camera.camera_from_world.clone()
    matrix[:, 0, 3] -= x
    return replace(camera, camera_from_world=matrix)


def test_a_keyframe_holds_what_was_rendered(scene):
    camera = scene.camera(width=SIZE[0], height=SIZE[1])
    image, _ = render_image(scene, camera, Bounds(), PLAIN)
    (received,) = read(keyframe(scene, camera, 0))
    depth = image.gbuffer.depth[0]
    known = torch.isfinite(depth)
    assert torch.equal(torch.isfinite(received.depth), known)
    near = received.header.depth.near
    assert near == pytest.approx(float(depth.min()))
    assert float((near / received.depth - near / depth)[known].abs().amax()) <= received.header.depth.error
    exact = (image.to_srgb()[0] * 255 + 0.5).to(torch.uint8).numpy().astype(int)
    assert np.abs(exact - received.codes.numpy()).max() <= 1
    assert float((received.camera.camera_from_world - camera.camera_from_world).abs().amax()) < 1e-12


def test_a_picture_of_a_stream_tells_itself_in_a_line(scene):
    told = repr(read(keyframe(scene, scene.camera(width=SIZE[0], height=SIZE[1]), 0))[0])
    assert "\n" not in told and "depth=float32 (48, 64)" in told and len(told) < 500


def test_an_unmoved_camera_sees_the_picture_again(scene):
    """Better than 50 dB is asked for; colours travel without loss, so nothing is lost at all."""
    camera = scene.camera(width=SIZE[0], height=SIZE[1])
    (received,) = read(keyframe(scene, camera, 0))
    made = reproject(depth_images_of([received]), received.camera)
    assert float(made.valid.float().mean()) == 1.0
    assert np.abs(display_bytes(made.color[0]).astype(int) - received.codes.numpy()).max() <= 1


def test_extra_layers_halve_the_holes(scene):
    camera = scene.camera(width=2 * SIZE[0], height=2 * SIZE[1])
    images = read(keyframe(scene, camera, 2))
    depth = images[0].depth
    reach = 0.06 * float(depth[torch.isfinite(depth)].median())
    for x in (reach, -reach, 0.5 * reach):
        # The middle only: what enters at the border is the business of overscan.
        view = aside(camera, x).sub_camera(24, 18, camera.width - 48, camera.height - 36)
        alone = reproject(depth_images_of(images[:1]), view).valid
        together = reproject(depth_images_of(images), view).valid
        holes = [float((~valid).float().mean()) for valid in (alone, together)]
        assert holes[0] > 0.001
        assert holes[1] <= 0.5 * holes[0], (x, holes)


def test_extra_layers_hold_little_and_nothing_twice(scene):
    camera = scene.camera(width=SIZE[0], height=SIZE[1])
    first, *extra = read(keyframe(scene, camera, 3))
    assert len(extra) == 3
    for image in extra:
        assert image.header.mask is not None
        assert 0.0 < float(image.known.float().mean()) < 0.25
        assert torch.equal(image.camera.rotation, first.camera.rotation)
    assert float(torch.isinf(first.depth).float().mean()) > 0.05  # the box stands in the open
    sky = sum((image.known & torch.isinf(image.depth)).int() for image in extra)
    assert int(sky.max()) <= 1
    assert not bool((sky.bool() & torch.isinf(first.depth)).any())


def test_extra_layers_stay_behind_the_picture_at_its_own_eye(scene):
    """What comes out from behind an outline must not nibble at the outline."""
    camera = scene.camera(width=2 * SIZE[0], height=2 * SIZE[1])
    images = read(keyframe(scene, camera, 2))
    first, rest = (reproject(depth_images_of(part), camera) for part in (images[:1], images[1:]))
    front = rest.valid & (rest.depth < 0.99 * first.depth)
    assert float(rest.valid.float().mean()) > 0.01
    assert float(front.float().mean()) < 2e-3


def test_new_samples_continue_behind_what_hid_them():
    """A plate before a wall: beside its outline the wall goes on, with the wall's depth and colour."""
    wall, plate = torch.tensor([0.1, 0.6, 0.2]), torch.tensor([0.9, 0.0, 0.0])
    scene = Scene(
        meshes=[square(4.0, 0.0, 0), square(0.5, 1.0, 1)],
        materials=[Material(diffuse=torch.zeros(3), emission=color) for color in (wall, plate)],
        ambient=torch.zeros(3),
    )
    camera = Cameras.look_at((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), width=96, height=64)
    image, _ = render_image(scene, camera, Bounds(), PLAIN, RenderHistory())
    around = cameras_around(camera, image.visibility.depth[0], 2)
    for layer in extra_layers(image.scene, image.visibility, around, PLAIN, image.history):
        samples = layer.known & torch.isfinite(layer.depth)
        assert int(samples.sum()) > 20
        assert torch.allclose(layer.depth[samples], torch.tensor(3.0))
        assert torch.allclose(layer.radiance[samples], wall, atol=1e-5)
        seen = rasterize_visibility(scene.geometry, layer.camera)
        behind = samples & (seen.depth[0] < 2.5)
        assert int(behind.sum()) >= 5


def test_the_first_extra_camera_goes_where_the_client_goes(scene):
    camera = scene.camera(width=SIZE[0], height=SIZE[1])
    depth = torch.full((4, 4), 2.0)
    ahead = cameras_around(camera, depth, 2, direction=(0.0, 3.0, 0.0), baseline=0.2)
    step = ahead[0].eye[0] - camera.eye[0]
    assert step.tolist() == pytest.approx([0.0, 0.2, 0.0], abs=1e-9)
    assert float((cameras_around(camera, depth, 1, baseline=99.0)[0].eye - camera.eye).norm()) == pytest.approx(0.5)
    assert cameras_around(camera, torch.full((4, 4), torch.inf), 4)[3].width == camera.width
    assert cameras_around(camera, depth, 0) == []


def test_only_sky_that_was_sent_is_drawn():
    """Behind everything, farther than all; where a mask says nothing there is nothing, and no surface either."""
    camera = Cameras.look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), width=3, height=2)
    depth = torch.tensor([[1.0, torch.inf, torch.inf], [2.0, torch.inf, 1.5]])
    known = torch.tensor([[True, True, False], [True, False, True]])
    image = KeyframeImage(None, camera, depth, torch.full((2, 3, 3), 128, dtype=torch.uint8), known)
    sky = known & torch.isinf(depth)
    drawn = depth_images_of([image])
    assert torch.equal(torch.isfinite(drawn.depth[0]), known)
    assert torch.equal(drawn.triangle[0] == 0, known) and torch.equal(drawn.object_id[0] == 0, known)
    assert bool((drawn.depth[0][sky] > 1e3 * 2.0).all()) and torch.equal(
        drawn.depth[0][known & ~sky], depth[known & ~sky]
    )
    assert bool((drawn.color[0].amax(-1) > 0).eq(known).all())
    plain = depth_images_of([image], sky=False)
    assert torch.equal(torch.isfinite(plain.depth[0]), known & ~sky)


def test_normals_of_a_plane():
    camera = Cameras.look_at((0.3, 0.2, 2.0), (0.0, 0.0, 0.0), width=24, height=16, fov_deg=60.0)
    origin, direction = camera.rays()
    normal = torch.tensor([0.2, 0.3, 1.0], dtype=torch.float64)
    depth = (-(origin[0] @ normal) / (direction[0] @ normal)).float()
    depth[4, 5] = torch.inf
    found = plane_normals(depth, camera)
    wanted = torch.nn.functional.normalize(normal, dim=0).float()
    inside = torch.isfinite(depth)
    assert float((found[inside] - wanted).abs().amax()) < 1e-3


def test_normals_of_a_bent_surface_are_between_those_towards_both_sides():
    """A parabola of inverse depth: the mean of both differences is its derivative, either alone is half a step off."""
    camera = Cameras.look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), width=24, height=3, fov_deg=60.0)
    u = torch.arange(24, dtype=torch.float64) + 0.5
    inverse = 0.5 + 2e-4 * u**2
    found = plane_normals((1.0 / inverse).expand(3, 24), camera)[1, 12].double() @ camera.rotation[0].T
    slope = 4e-4 * u[12]
    focal, centre = camera.intrinsics[0, 0, 0], camera.intrinsics[0, 0, 2]
    rest = inverse[12] - slope * (u[12] - centre)
    wanted = -torch.stack([focal * slope, torch.zeros_like(rest), rest])
    assert torch.allclose(found, wanted / wanted.norm(), atol=1e-5)


def test_a_sample_without_neighbours_faces_the_camera():
    camera = Cameras.look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), width=3, height=3)
    depth = torch.full((3, 3), torch.inf)
    depth[1, 1] = 2.0
    assert plane_normals(depth, camera)[1, 1].tolist() == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)


def test_a_cord_faces_the_camera():
    """One pixel wide, before a wall; the sample beside it is of the wall, as before."""
    camera = Cameras.look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), width=5, height=5)
    depth = torch.full((5, 5), 3.0)
    depth[:, 2] = 2.0
    assert torch.allclose(plane_normals(depth, camera), torch.tensor([0.0, 0.0, 1.0]).expand(5, 5, 3), atol=1e-6)


def test_a_sample_whose_only_neighbour_is_of_another_surface_faces_the_camera():
    """At the border of a mask, beside something near."""
    camera = Cameras.look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), width=5, height=5)
    depth = torch.full((5, 5), torch.inf)
    depth[:, :2], depth[:, 2] = 0.1, 3.0
    assert torch.allclose(plane_normals(depth, camera)[:, 2], torch.tensor([0.0, 0.0, 1.0]).expand(5, 3), atol=1e-6)


def test_extra_cameras_go_different_ways(scene):
    camera = scene.camera(width=SIZE[0], height=SIZE[1])
    right = camera.rotation[0, 0]
    around = cameras_around(camera, torch.full((4, 4), 2.0), 4, direction=right.tolist())
    steps = [torch.nn.functional.normalize(c.eye[0] - camera.eye[0], dim=0) for c in around]
    assert float(steps[0] @ right) == pytest.approx(1.0)
    for k, step in enumerate(steps):
        assert all(float(step @ other) < 0.9 for other in steps[:k])


def test_nothing_is_sent_of_a_camera_that_stands_behind_something():
    """To the left there is a wall, through which the extra camera would look at a room that nobody sees."""
    side = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # x to y, y to z, z to x
    wall, end = square(40.0, 0.0, 0), square(6.0, 0.0, 0)
    screen = replace(end, vertices=end.vertices @ side.T + torch.tensor([-0.05, 0.0, 1.0]))
    scene = Scene(meshes=[wall, screen], ambient=torch.ones(3))
    camera = Cameras.look_at((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), width=96, height=64)
    image, _ = render_image(scene, camera, Bounds(), PLAIN, RenderHistory())
    around = cameras_around(camera, image.visibility.depth[0], 2)
    shares = []
    for layer in extra_layers(image.scene, image.visibility, around, PLAIN, image.history):
        shares.append(float(layer.known.float().mean()))
    assert shares[1] == 0.0
    assert shares[0] < 0.4


@pytest.mark.parametrize("method", ["conventional", "nonredundant", "depth_peeling"])
def test_containers_of_every_sampling_method(scene, method):
    view = View(width=SIZE[0], height=SIZE[1])
    job = DepthImages(
        scene=SceneSource(id="cornell_box"),
        views=(view,),
        method=method,
        bits=14,
        color="jpeg",
        quality=90,
        around=2,
        options={"reflections": "off"},
    )
    made = make_container(scene, job)
    images = read_container(made["container"], max_pixels=10**5, max_images=4)
    assert [image.header.layer for image in images] == [0, 1]
    assert images[0].header.depth.bits == 14
    assert bool(images[1].known.all()) == (method == "conventional")


def test_containers_that_are_not_whole(scene):
    (message,) = keyframe(scene, scene.camera(width=16, height=12), 0)
    for bad in (b"", message[:-8], message + b"TRDI", b"\0" * 64):
        with pytest.raises(ProtocolError):
            read_container(bad, max_pixels=10**5, max_images=4)
    with pytest.raises(ProtocolError, match="may hold 1 pictures"):
        read_container(message * 2, max_pixels=10**5, max_images=1)
    with pytest.raises(ProtocolError, match="of 100 pixels"):
        read_container(message, max_pixels=100, max_images=4)
    damaged = bytearray(message)
    damaged[-20] ^= 1
    with pytest.raises(CodecError, match="checksum"):
        read_container(bytes(damaged), max_pixels=10**5, max_images=4)
    other = keyframe(scene, scene.camera(width=20, height=12), 0)
    with pytest.raises(ProtocolError, match="one size"):
        depth_images_of(read([message, *other]))


def test_cameras_of_clients_must_be_rigid(scene):
    camera = scene.camera(width=16, height=12)
    header = header_of(camera)
    single = tuple(float(np.float32(v)) for v in header.world_from_camera)
    again = cameras_of(replace_matrix(header, single))
    assert float((again.rotation[0] @ again.rotation[0].T - torch.eye(3)).abs().amax()) < 1e-12
    assert float((again.camera_from_world - camera.camera_from_world).abs().amax()) < 1e-6
    m = header.world_from_camera
    for bad in ((*m[:3], m[3], *(2.0 * v for v in m[4:8]), *m[8:]), (*m[:12], 0.0, 0.0, 1.0, 1.0), (0.0,) * 16):
        with pytest.raises(CameraError, match="world_from_camera"):
            cameras_of(replace_matrix(header, bad))
    mirrored = (-m[0], m[1], m[2], m[3], -m[4], m[5], m[6], m[7], -m[8], m[9], m[10], m[11], *m[12:])
    with pytest.raises(CameraError, match="world_from_camera"):
        cameras_of(replace_matrix(header, mirrored))


def replace_matrix(header: CameraHeader, matrix: tuple[float, ...]) -> CameraHeader:
    return CameraHeader(
        world_from_camera=matrix,
        **{n: getattr(header, n) for n in ("fx", "fy", "cx", "cy", "width", "height", "near")},
    )


def test_times_and_plan_are_in_the_header(scene):
    camera = scene.camera(width=16, height=12)
    image, plan = render_image(scene, camera, Bounds(budget_ms=1e4), PLAIN)
    stamp = Stamp(id=1, layers=1, pose=4, time_ms=12.5)
    data = first_message(stamp, camera, image.gbuffer.depth[0], image.radiance[0], render_ms=3.0, plan=plan)
    header = decode(data).message
    assert (header.pose, header.time_ms, header.render_ms) == (4, 12.5, 3.0)
    assert header.plan is not None and {"pass", "runs", "reason"} <= set(header.plan["rows"][0])


def test_a_crease_takes_the_side_that_bends_less() -> None:
    """Slopes of one to three are two surfaces: a mean of both would be the normal of neither."""
    camera = Cameras.look_at([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], width=16, height=4, fov_deg=40.0)
    steps = torch.tensor([0.01] * 8 + [0.03] * 7)
    inverse = 0.2 + torch.cat([torch.zeros(1), steps.cumsum(0)])
    normal = plane_normals((1.0 / inverse).expand(4, 16), camera)
    torch.testing.assert_close(normal[:, 8], normal[:, 4], atol=1e-4, rtol=0)
    assert float((normal[:, 8] - normal[:, 12]).abs().max()) > 0.05
