"""An armchair turns in its room: python scene_editing.py [PIXELS] [FRAMES]."""

import math
import sys

import torch
import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 320
frames = int(sys.argv[2]) if len(sys.argv) > 2 else 24
room = tr.load("living_room", size=40_000)  # about so many triangles
camera = room.camera(width=size, height=size * 3 // 4)
low, high = tr.Scene(meshes=room.parts("armchair"), materials=room.materials).bounds
middle = (low + high) / 2


def turned(angle: float) -> torch.Tensor:
    """(4,4) turn about the upright axis through the middle of the chair."""
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[0, 0] = matrix[2, 2] = math.cos(angle)
    matrix[0, 2], matrix[2, 0] = math.sin(angle), -math.sin(angle)
    matrix[:3, 3] = middle - matrix[:3, :3] @ middle
    return matrix


def film():
    history = tr.RenderHistory()  # trees and maps of what stands still are kept
    for number in range(frames):
        image = tr.render(room.moved("armchair", turned(0.5 * number / frames)), camera, history=history)
        history = image.history
        yield image


print(tr.write_film("armchair.mp4", film(), fps=12))
