"""Fog in a photo whose depth is known: python fog_photo.py [PIXELS]."""

import sys

import torchrender as tr
from torchrender.photo.fog import FogMedium, FogPhoto, Marks

size = int(sys.argv[1]) if len(sys.argv) > 1 else 512
scene = tr.load("city", size=20_000)
image = tr.render(scene, width=size, height=size)  # stands for a photo: linear light (H,W,3)
photo, depth = image.displayed()[0], image.gbuffer.depth[0]  # metres along the camera's axis

fog = FogPhoto(photo, Marks(), depth=depth)
for metres in (200, 50):
    made = fog.foggy(FogMedium.of(visibility=metres))
    tr.write_film(f"fog_{metres}", [made.composite])  # a folder with one picture
    print(f"visibility {metres} m: {float(made.transmittance.mean()):.0%} of the light arrives")
