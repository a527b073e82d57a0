"""Lights and cameras that hang on nodes: they turn and move with them, scale and mirroring do not count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from torchrender.errors import InputError
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, PointLight, SpotLight
from torchrender.scene.motion.records import Array


def axes_of(world: Array) -> Array:
    """(3,3) orthonormal right-handed axes of a node (4,4) as columns.

    Raises:
        InputError: the transform is singular.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        z = world[:3, 2]
        x = np.cross(world[:3, 1], z)
        lengths = np.linalg.norm(z), np.linalg.norm(x)
    if not min(lengths) > 0 or not np.isfinite(lengths).all():
        raise InputError("its node has no orientation: the transform is singular")
    z, x = z / lengths[0], x / lengths[1]
    return np.stack([x, np.cross(z, x), z], axis=1)


def camera_at(camera: Cameras, world: Array) -> Cameras:
    """A camera of the node's frame, which looks along its -z with y up, at the node's place."""
    axes = axes_of(world)
    rotation = (axes * np.array([1.0, -1.0, -1.0])).T
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ world[:3, 3]
    return replace(camera, camera_from_world=torch.from_numpy(pose)[None])


def light_at(light: Light, world: Array) -> Light:
    """A light of the node's frame, which shines along its -z, at the node's place."""
    position = torch.from_numpy(world[:3, 3].copy())
    if isinstance(light, PointLight):
        return replace(light, position=position)
    direction = torch.from_numpy(-axes_of(world)[:, 2].copy())
    if isinstance(light, DirectionalLight):
        return replace(light, direction=direction)
    assert isinstance(light, SpotLight)
    return replace(light, position=position, direction=direction)
