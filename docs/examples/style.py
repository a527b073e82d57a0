"""Materials for a room from the colours of a photo: python style.py [PIXELS] [PHOTO]."""

import sys

import torchrender as tr
from torchrender.images.files import read_image

size = int(sys.argv[1]) if len(sys.argv) > 1 else 400
room = tr.load("cornell_box")
if len(sys.argv) > 2:
    photo = read_image(sys.argv[2])
else:  # a picture stands for a photo: linear light (H,W,3)
    photo = tr.render(tr.load("washroom", size=10_000), width=size, height=size).displayed()[0]

style = tr.style_scene(room, photo, tr.StyleOptions(views=8, width=size, height=size, seed=3))
print(style.names, f"error before {style.before.total:.3f}, after {style.after.total:.3f}")
style.save("styled.toml")  # with its lights, and the meshes in a GLB file beside it
tr.write_film("styled", [tr.contact_sheet(style).clamp(0, 1)])
