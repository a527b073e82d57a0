"""Depth images from a running service, reprojected here: python stream.py [ADDRESS] [PIXELS]."""

import sys

import torchrender as tr
from torchrender.client import StreamClient

address = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8000"
size = int(sys.argv[2]) if len(sys.argv) > 2 else 320

with StreamClient.connect(address, "cornell_box", size=(size, size), layers=2) as client:
    for step in range(3):  # a step to the right in each round
        camera = tr.Cameras.look_at([0.278 + 0.02 * step, 0.273, -0.8], [0.278, 0.273, 0.3], width=size, height=size)
        pose = client.send_pose(camera)
        keyframe = client.receive(pose=pose)  # not one that an earlier pose asked for
        picture = client.view(camera)  # out of the depth images that were received, reprojected here
        print(f"keyframe {keyframe.id}: {keyframe.bytes} bytes, {picture.valid.float().mean():.0%} of the pixels known")
