"""Whole files of kinds that others' code reads: pictures of Basis Universal and OpenEXR, and compressed points."""

from __future__ import annotations

import base64
import tempfile
import zlib
from pathlib import Path

import numpy as np
import torch

from torchrender.images.files import write_image
from torchrender.points.cloud import PointCloud
from torchrender.points.file import write_points
from torchrender.points.tree import build_patches

# Eight by eight texels of four colours; made by alktx2 0.1.7, which is Basis Universal's own encoder, packed by zlib.
_KTX2 = {
    "etc1s": (
        "c-mX-9TK5nWU!l;ONxsD2pEBw1BzjQ5ea7iu?-L}0b&&(J^@uT8%ifLLTF|NRA2+8nHVe>7Bez2Fas5Ez%8+dtNRZG4h;7E$"
        "b5Mq4RmICQD#YM5rb1=ab~eXXkKPnYEf}wj)IY%p#cK}8_-5GpgLY4HbAqR35r2ZlW>q}08$PT7v+0n8G;#DK%5JC>_H5HV7"
        "6o9desgF7X|?!yJZJ=%09b^^ACiCgocK)0!3D=TD6La;h+n|+)ww_Js1rb9l&<%6krr&0-G=;yk-%D0iyy)xPgO(VYV<I0Qz"
        "7wzW"
    ),
    "uastc": (
        "c-mX-9TK5nWU!l;ONxsD2pEBw1BzjQ5sE<|1Bi8icnXw82M3_E0~!re%fz6;u#Az3fti_sK>)6+o*Bma4+Qc+8tAO@qRf)iA"
        "_k|#;>==&(7epD)S}|V90emiLjwi|7Lcxb1_p7-)<^bR;o2FdH%)t9FY*=6zuw&byI#f}u0UK)PEMfY9Lzfm09x)M=K"
    ),
}


def ktx2(codec: str) -> bytes:
    """A picture in the codec "etc1s" or "uastc"."""
    return zlib.decompress(base64.b85decode(_KTX2[codec]))


def coded() -> dict[str, tuple[str, bytes]]:
    """Suffix and content of each file, by name."""
    rng = np.random.default_rng(0)
    cloud = PointCloud(
        position=torch.from_numpy(rng.normal(size=(200, 3))),
        normal=torch.from_numpy(rng.normal(size=(200, 3))).float(),
        radius=torch.full((200,), 0.1),
        color=torch.rand(200, 3, generator=torch.Generator().manual_seed(0)),
    )
    with tempfile.TemporaryDirectory() as folder:
        points, picture = Path(folder) / "a.trp", Path(folder) / "a.exr"
        write_points(points, build_patches(cloud))
        write_image(picture, torch.rand(6, 5, 3, generator=torch.Generator().manual_seed(1)))
        found = {"points": (".trp", points.read_bytes()), "exr": (".exr", picture.read_bytes())}
    return found | {f"ktx2 {codec}": (".ktx2", ktx2(codec)) for codec in _KTX2}
