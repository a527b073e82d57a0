"""Photos with depth and poses as planes and points: python walkthrough.py [PIXELS]."""

import sys

import torch
import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 320
room = tr.load("cornell_box")
eyes = [[0.2, 0.3, -0.6], [0.28, 0.27, -0.6], [0.36, 0.3, -0.6]]  # a real capture: tr.load_rgbd(FOLDER)
cameras = tr.Cameras.cat([tr.Cameras.look_at(eye, [0.278, 0.25, 0.3], width=size, height=size) for eye in eyes])
photos = tr.render(room, cameras)
K, R, t = cameras.opencv()
capture = tr.RgbdSequence.from_tensors(photos.displayed().permute(0, 3, 1, 2), photos.gbuffer.depth[:, None], K, R, t)

walk = tr.build_walkthrough(capture)
print(f"{len(walk.planes)} planes, {walk.size_bytes} bytes")
tr.write_walkthrough("room.trw", walk)

between = tr.Cameras.look_at([0.24, 0.32, -0.5], [0.278, 0.25, 0.3], width=size, height=size)
seen = tr.draw_walkthrough(walk, between)
print(f"{seen.covered.float().mean():.0%} of the new view is covered")
tr.write_film("between", [seen.image.clamp(0, 1)])
assert torch.isfinite(seen.image).all()
