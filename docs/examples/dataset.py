"""A training set of depth, normals and ids for a DataLoader: python dataset.py [PIXELS] [VIEWS] [WORKERS] [SCENE]."""

import sys

import torch
import torchrender as tr
from torch.utils.data import DataLoader, Dataset


class Views(Dataset):
    """Maps of a scene from random places around it; each item is a batch of views, drawn in one call."""

    def __init__(self, name: str, views: int, size: int, batch: int = 25) -> None:
        self.name, self.views, self.size, self.batch = name, views, size, batch
        self.scene = None  # loaded by each worker for itself

    def __len__(self) -> int:
        return (self.views + self.batch - 1) // self.batch

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        self.scene = self.scene or tr.load(self.name)
        random = torch.Generator().manual_seed(index)
        low, high = self.scene.bounds
        eyes = low + (high - low) * (0.3 + 0.4 * torch.rand(self.batch, 3, generator=random, dtype=torch.float64))
        targets = low + (high - low) * torch.rand(self.batch, 3, generator=random, dtype=torch.float64)
        pairs = zip(eyes[: self.views - index * self.batch], targets)
        views = [tr.Cameras.look_at(e, t, width=self.size, height=self.size) for e, t in pairs]
        return tr.rasterize(self.scene, tr.Cameras.cat(views), outputs=("depth", "normal", "object_id"))


if __name__ == "__main__":
    given = sys.argv[1:] + ["256", "200", "2", "living_room"][len(sys.argv) - 1 :]
    size, views, workers = (int(word) for word in given[:3])
    start = {"num_workers": workers, "multiprocessing_context": "spawn"} if workers else {}
    loader = DataLoader(Views(given[3], views, size), batch_size=None, shuffle=False, **start)
    for number, maps in enumerate(loader):
        torch.save(maps, f"views_{number:03d}.pt")
        print(number, {name: tuple(tensor.shape) for name, tensor in maps.items()})
