"""Thousands of views by several processes, to be stopped and gone on with: python batch.py [PIXELS] [VIEWS] [SCENE]."""

import sys
from pathlib import Path

import torchrender as tr
from torchrender import batch

if __name__ == "__main__":
    given = sys.argv[1:] + ["256", "1000", "city"][len(sys.argv) - 1 :]
    size, views, name = int(given[0]), int(given[1]), given[2]
    scene = tr.load(name)
    path = tr.built_in_path(scene, "orbit")
    cameras = path.cameras(views, width=size, height=size, near=1e-3 * scene.diagonal)
    job = batch.Job(batch.SceneSource(name), cameras, what="depth", shards=True)
    outcome = batch.run(job, "views", tell=lambda done, total: print(f"{done} of {total}"))
    print(outcome)
    print(sorted(file.name for file in Path("views").iterdir()))
