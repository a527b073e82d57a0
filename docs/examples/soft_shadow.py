"""The soft shadow of a lamp, fast and exact: python soft_shadow.py [PIXELS]."""

import sys

import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 512
lamp = tr.RectLight(corner=[-0.5, 2.5, -0.5], edge_u=[1, 0, 0], edge_v=[0, 0, 1], radiance=6)  # shines down: u x v
scene = tr.Scene(meshes=[tr.Mesh.plane(6), tr.Mesh.box(0.8, [0, 0.7, 0], name="box")], lights=[lamp], ambient=0.05)
camera = tr.Cameras.look_at([2.5, 2.0, 3.0], [0, 0.3, 0], width=size, height=size, fov_deg=45)

guessed = tr.render(scene, camera)  # penumbrae guessed from one shadow map
exact = tr.render(scene, camera, options=tr.RenderOptions(area_shadows="sampled"))  # 16 x 16 rays a pixel
exact.save("soft_shadow.png")

lit = tr.soft_shadow(scene, lamp, tr.rasterize(scene, camera)).visibility  # (1,1,H,W): share of the lamp that is seen
print(f"{((lit > 0) & (lit < 1)).float().mean():.1%} of the pixels lie in the penumbra")
