"""The pose of a forest of nodes at a time: key frames to local transforms, local to world.

Source: glTF 2.0 specification, section 3.11 and appendix C (interpolation).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from torchrender.numerics.quaternions import normalised, rotations
from torchrender.scene.motion.records import CUBIC, STEP, Animation, Array, Channel, Nodes


def sample(channel: Channel, time: float) -> Array:
    """(W,) value of a channel; before the first and after the last key frame it stands still."""
    times, values = channel.times, channel.values
    high = int(np.searchsorted(times, time, side="right"))
    if channel.interpolation == CUBIC:
        values = values[:, 1]
    if high == 0 or high == len(times):
        return _rotation_checked(channel, values[min(high, len(times) - 1) if high == 0 else -1])
    low = high - 1
    if channel.interpolation == STEP:
        return _rotation_checked(channel, values[low])
    span = times[high] - times[low]
    share = (time - times[low]) / span
    if channel.interpolation == CUBIC:
        return _rotation_checked(channel, _hermite(channel.values[low], channel.values[high], span, share))
    if channel.path == "rotation":
        return slerp(values[low], values[high], share)
    mixed: Array = values[low] + (values[high] - values[low]) * share
    return mixed


def _hermite(first: Array, second: Array, span: float, t: float) -> Array:
    square, cube = t * t, t * t * t
    curve: Array = (
        (2 * cube - 3 * square + 1) * first[1]
        + span * (cube - 2 * square + t) * first[2]
        + (-2 * cube + 3 * square) * second[1]
        + span * (cube - square) * second[0]
    )
    return curve


def _rotation_checked(channel: Channel, value: Array) -> Array:
    return normalised(value) if channel.path == "rotation" else value


def slerp(first: Array, second: Array, share: float) -> Array:
    """Between two quaternions (4,) along the shorter arc at constant speed."""
    first, second = normalised(first), normalised(second)
    cosine = float(first @ second)
    if cosine < 0:
        second, cosine = -second, -cosine
    if cosine > 0.9995:  # so close that the sine would cancel
        return normalised(first + (second - first) * share)
    angle = np.arccos(min(cosine, 1.0))
    mixed: Array = (np.sin((1 - share) * angle) * first + np.sin(share * angle) * second) / np.sin(angle)
    return mixed


def transforms(translation: Array, rotation: Array, scale: Array) -> Array:
    """(N,4,4) of translations (N,3), quaternions (N,4) and scales (N,3)."""
    out = np.zeros((len(translation), 4, 4))
    out[:, 3, 3] = 1.0
    out[:, :3, :3] = rotations(rotation) * scale[:, None, :]
    out[:, :3, 3] = translation
    return out


def posed(
    nodes: Nodes, animation: Animation | None, time: float | None, root: Array
) -> tuple[Array, Mapping[int, Array]]:
    """``world_from_node`` (N,4,4) and the weights of morph targets by node; the rest pose without a time."""
    translation, rotation, scale = nodes.translation.copy(), nodes.rotation.copy(), nodes.scale.copy()
    places = {"translation": translation, "rotation": rotation, "scale": scale}
    matrices, weights = dict(nodes.matrices), dict(nodes.weights)
    for channel in animation.channels if animation is not None and time is not None else ():
        value = sample(channel, time or 0.0)
        if channel.path == "weights":
            weights[channel.node] = value
        else:
            places[channel.path][channel.node] = value
            matrices.pop(channel.node, None)
    local = transforms(translation, rotation, scale)
    for node, matrix in matrices.items():
        local[node] = matrix
    # Damaged files hold numbers whose products overflow; the meshes then say that they are not finite.
    with np.errstate(over="ignore", invalid="ignore"):
        # Each round joins chains of twice the length: few rounds, however deep the tree.
        chains = np.concatenate([local, np.eye(4)[None]])
        for up in nodes.ancestors:
            chains = chains[up] @ chains
        worlds = root @ chains[:-1]
    return worlds, weights
