"""Fog for a photo: from marks and a medium to a picture.

Source: specification 12, section 6.
"""

from __future__ import annotations

import time
import warnings
from copy import copy
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.checks import options_of
from torchrender.errors import InputError, OptionError
from torchrender.photo.fog import outdoor
from torchrender.photo.fog.depth.labels import SKY, VERTICAL, Labelled, depth_from_labels, label_map, outdoor_camera
from torchrender.photo.fog.depth.measured import filled
from torchrender.photo.fog.depth.segments import guess_sky
from torchrender.photo.fog.indoor import RoomScene, prepare_room
from torchrender.photo.fog.lamps import lamp_light, place_lamps
from torchrender.photo.fog.marks.records import Marks, scaled
from torchrender.photo.fog.options import FogMedium, FogOptions, FogWarning
from torchrender.photo.fog.picture import FogPicture, prepare
from torchrender.photo.fog.room_fog import RoomFog

SATURATED = 0.98
ADJUSTABLE = ("top", "loss", "ground_bounce", "light_gain", "shaft_gain")
"""Options that a prepared photo can change."""


class FogPhoto:
    """One photo with its marks, ready for any medium: make it once, then call :meth:`foggy` for each medium.

    Args:
        photo: (H,W) or (H,W,C) linear light, C from 1 to 4.
        marks: a room, or outdoor regions, in pixels of the photo (or of the size that they name).
        depth: (H,W) metres, camera z; 0, NaN or infinite where unknown. None: that of the marks.
        labels: (H,W) whole numbers, 0 ground, 1 vertical, 2 sky.

    Raises:
        InputError: what does not fit; names the argument or mark.
    """

    def __init__(
        self, photo: Tensor, marks: Marks, options: FogOptions | None = None, *, depth: Tensor | None = None,
        labels: Tensor | None = None,
    ) -> None:  # fmt: skip
        begin = time.perf_counter()
        self.options = options_of(options, FogOptions)
        self._photo = prepare(photo)
        work = self._photo.work
        h, w = work.shape[:2]
        marks = _fitted(marks, photo, (h, w))
        if depth is not None and tuple(depth.shape) != (h, w):
            depth = _resized_depth(depth, (h, w), tuple(photo.shape[:2]))
        self._room: RoomFog | None = None
        self._outdoor: outdoor.OutdoorScene | None = None
        if marks.indoor:
            if labels is not None:
                warnings.warn("labels are not used: the marks show a room", FogWarning, stacklevel=2)
            scene = prepare_room(work, marks, self.options, depth)
            self._room = RoomFog(scene, self.options)
            self.camera, self.depth = scene.room.camera, scene.seen.depth
        else:
            self._outdoor = _outdoor_scene(work, marks, depth, labels, self.options)
            self.camera, self.depth = self._outdoor.camera, self._outdoor.depth
        self._lamps = place_lamps(marks.lamps, work, self.camera, self.depth)
        self._bright = self._recovered()
        self.prepare_ms = 1e3 * (time.perf_counter() - begin)

    @property
    def room(self) -> RoomScene | None:
        """The room, indoors."""
        return None if self._room is None else self._room.scene

    @property
    def outdoors(self) -> outdoor.OutdoorScene | None:
        """The ground and its light, outdoors."""
        return self._outdoor

    def adjusted(self, options: FogOptions) -> FogPhoto:
        """The same photo with other values of :data:`ADJUSTABLE`; all that was prepared is shared.

        Raises:
            OptionError: something else differs, or shafts were switched off and shall come back.
        """
        own = {name: getattr(self.options, name) for name in ADJUSTABLE}
        if replace(options, **own) != self.options:
            raise OptionError(f"only {', '.join(ADJUSTABLE)} can be adjusted: prepare the photo anew for the rest")
        if options == self.options:
            return self
        other = copy(self)
        other.options = options
        if self._room is not None:
            other._room = self._room.adjusted(options)
        elif self._outdoor is not None:
            other._outdoor = replace(self._outdoor, options=options)
        return other

    def facts(self) -> dict[str, object]:
        """What was found out about the photo."""
        return self._room.scene.facts() if self._room is not None else self._outdoor.facts()  # type: ignore[union-attr]

    def _recovered(self) -> Tensor | None:
        """(H,W,1) factor of light that the camera cut off, in lamps, lights and sky."""
        if self.options.highlights == 1.0:
            return None
        emits = self._lamps.mask.clone()
        if self._room is not None:
            emits |= self._room.scene.glowing
        elif self._outdoor is not None:
            emits |= self._outdoor.sky > 0.5
        mask = self._photo.full(emits.float()) > 0.5
        cut = mask & (self._photo.light.amin(dim=-1) >= SATURATED)
        return torch.where(cut, self.options.highlights, 1.0)[..., None]

    def foggy(self, medium: FogMedium) -> FogPicture:
        """The photo in a medium.

        Raises:
            InputError: a density that varies, outdoors.
        """
        begin = time.perf_counter()
        if self._room is not None:
            through = self._room.transmittance(medium)
            mid = time.perf_counter()
            added = self._room.scattered(medium)
            top = float(self._room.scene.room.high[1])
        else:
            assert self._outdoor is not None
            if medium.density is not None:
                raise InputError("density must be None outdoors: the layer is the same everywhere")
            through = outdoor.transmittance(self._outdoor, medium)
            mid = time.perf_counter()
            added = outdoor.scattered(self._outdoor, medium)
            top = self.options.top
        if self._lamps.lights and bool((medium.scattering > 0).any()):
            if medium.density is not None:
                warnings.warn("lamps shine through air of density 1, not of the grid", FogWarning, stacklevel=2)
            added = added + lamp_light(self._lamps, self.camera, self.depth, medium, top)
        if bool(self._lamps.mask.any()):
            own = torch.exp(-self._lamps.length[..., None] * medium.extinction)
            through = torch.where(self._lamps.mask[..., None], own, through)
        end = time.perf_counter()
        through, added = self._photo.full(through).clamp(0.0, 1.0), self._photo.full(added).clamp_min(0.0)
        light = self._photo.light if self._bright is None else self._photo.light * self._bright
        composite = light * through + added
        if bool((medium.extinction == 0).all()):
            composite = self._photo.light
        if self._photo.alpha is not None:
            composite = torch.cat([composite, self._photo.alpha], dim=-1)
        done = time.perf_counter()
        times = {"prepare": self.prepare_ms, "transmittance": 1e3 * (mid - begin), "scattered": 1e3 * (end - mid),
                 "composite": 1e3 * (done - end)}  # fmt: skip
        return FogPicture(composite, through, added, self._photo.full(self.depth.float()), self.facts(), times)


def add_fog(
    photos: Tensor, marks: Marks, medium: FogMedium, options: FogOptions | None = None, *, depth: Tensor | None = None,
    labels: Tensor | None = None,
) -> list[FogPicture]:  # fmt: skip
    """Fog for B photos of one camera and one set of marks, (B,H,W,C), or (H,W,C) for one; see :class:`FogPhoto`.

    Args:
        depth: (H,W) for all, or (B,H,W).
    """
    batch = photos if photos.dim() == 4 else photos[None]
    made = []
    for number, photo in enumerate(batch):
        own = depth[number] if depth is not None and depth.dim() == 3 else depth
        made.append(FogPhoto(photo, marks, options, depth=own, labels=labels).foggy(medium))
    return made


def _fitted(marks: Marks, photo: Tensor, size: tuple[int, int]) -> Marks:
    """Marks in pixels of the working size."""
    height, width = (int(v) for v in photo.shape[:2])
    own_w, own_h = marks.width or width, marks.height or height
    if abs(own_w / own_h - width / height) > 0.02 * width / height:
        raise InputError(f"the marks are those of a photo of {own_w}x{own_h} pixels, this one has {width}x{height}")
    if (own_w, own_h) != (width, height):
        warnings.warn(
            f"the marks are those of a photo of {own_w}x{own_h} pixels, and are stretched to {width}x{height}",
            FogWarning, stacklevel=3,
        )  # fmt: skip
    x, y = size[1] / own_w, size[0] / own_h
    return replace(marks, width=None, height=None) if (x, y) == (1.0, 1.0) else scaled(marks, x, y)


def _resized_depth(depth: Tensor, size: tuple[int, int], photo: tuple[int, ...]) -> Tensor:
    import cv2
    import numpy as np

    if depth.dim() != 2:
        raise InputError(f"depth must have shape (H, W), got {tuple(depth.shape)}")
    if abs(depth.shape[1] / depth.shape[0] - photo[1] / photo[0]) > 0.02 * photo[1] / photo[0]:
        raise InputError(
            f"depth must have the shape of the photo, {photo[1]}x{photo[0]}, got {depth.shape[1]}x{depth.shape[0]}"
        )
    grown = cv2.resize(depth.numpy().astype(np.float32), (size[1], size[0]), interpolation=cv2.INTER_NEAREST)
    return torch.from_numpy(grown)


def _outdoor_scene(
    photo: Tensor, marks: Marks, depth: Tensor | None, labels: Tensor | None, options: FogOptions
) -> outdoor.OutdoorScene:
    h, w = photo.shape[:2]
    camera = outdoor_camera(marks, w, h)
    if depth is None:
        label = label_map(marks, w, h, labels)
        if labels is None and not any(region.label == "sky" for region in marks.regions):
            label = torch.where(guess_sky(photo), SKY, label)
        return outdoor.prepare_outdoor(photo, marks, camera, depth_from_labels(label, marks, camera), options)
    known = torch.isfinite(depth) & (depth > 0)
    if labels is not None or marks.regions:
        label = label_map(marks, w, h, labels)
    else:
        far = known & (depth >= marks.outdoor.sky * 0.99)
        label = torch.where(far | (guess_sky(photo, known & ~far) & ~known), SKY, VERTICAL)
    found = filled(depth, label == SKY, marks.outdoor.sky)
    return outdoor.prepare_outdoor(photo, marks, camera, Labelled(label, found), options)
