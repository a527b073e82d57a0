"""A mirror, by depth images and by rays: python reflection.py [PIXELS]."""

import sys

import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 512
chrome = tr.Material(name="chrome", metallic=1.0, roughness=0.05, diffuse=[0.9, 0.9, 0.9])
red = tr.Material(name="red", diffuse=[0.7, 0.1, 0.08])
scene = tr.Scene(
    meshes=[
        tr.Mesh.plane(4),
        tr.Mesh.sphere(0.6, [0, 0.6, 0], material=1),
        tr.Mesh.box(0.5, [0.9, 0.25, 0.5], material=2),
    ],
    materials=[tr.Material(name="floor", diffuse=[0.6, 0.6, 0.55]), chrome, red],
)
camera = tr.Cameras.look_at([1.6, 1.3, 2.6], [0.1, 0.45, 0], width=size, height=size, fov_deg=45)

for way in ("clustered", "traced", "environment"):
    image = tr.render(scene, camera, options=tr.RenderOptions(reflections=way))
    image.save(f"mirror_{way}.png")
    print(f"{way}: {image.timings_ms['reflections']:.0f} ms")
