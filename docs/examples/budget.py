"""A time for a picture, and an error for another: python budget.py [PIXELS]."""

import sys

import torchrender as tr

size = int(sys.argv[1]) if len(sys.argv) > 1 else 512
scene = tr.load("washroom", size=20_000)  # about so many triangles
camera = scene.camera(width=size, height=size)

print(tr.plan(scene, camera, budget_ms=200))  # what would be done, and why
quick = tr.render(scene, camera, budget_ms=200)
print(f"asked 200 ms, predicted {quick.plan.predicted_ms:.0f}, took {quick.timings_ms['total']:.0f}")

history = quick.history or tr.RenderHistory()
for _ in range(3):  # from the second picture on, what lasts is there and predictions have learnt
    image = tr.render(scene, camera, history=history, budget_ms=200)
    history = image.history
print(f"the last of a sequence took {image.timings_ms['total']:.0f} ms")
