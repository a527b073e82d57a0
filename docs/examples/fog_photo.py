"""Fog in a photo whose depth is known: python fog_photo.py [PIXELS]."""

import sys

import torchrender as tr
from torchrender.photo.fog import FogMedium, FogPhoto, Marks

size = int(sys.argv[1]) if len(sys.argv) > 1 else 512
scene = tr.load("city", size=20_000)
image = tr.render(scene, width=size, height=size)  # stands for a photo: linear light (H,W,3)
photo, depth = image.displayed()[0], image.gbuffer.depth[0]  # metres along the camera's axis

fog = FogPhoto(photo, Marks(), depth=depth)
away = float(depth[depth.isfinite()].median())  # fog that hides a room is none over a town
for name, visibility in (("thin", 8 * away), ("thick", 3 * away)):
    made = fog.foggy(FogMedium.of(visibility=visibility))
    tr.write_film(f"fog_{name}", [made.composite])  # a folder with one picture
    print(f"visibility {visibility:.0f} m: {float(made.transmittance.mean()):.0%} of the light arrives")
