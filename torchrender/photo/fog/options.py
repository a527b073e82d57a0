"""What fog to put into a photo, and how exactly."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.checks import as_vector, check_choice, check_finite, check_range, checked_fields
from torchrender.errors import InputError, OptionError, TorchRenderWarning

CONTRAST = 3.912
"""Extinction times visibility: a black object keeps 2 % of its contrast (Koschmieder)."""
LARGEST_EXTINCTION = 20.0
TRANSMITTANCES = ("ratio", "patches", "centroid")
LOSSES = ("absorbed", "single", "none")
CURVES = ("srgb", "linear", "gamma")


class FogWarning(TorchRenderWarning):
    """Something about a photo, its marks or its depth is not used as it is."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FogMedium:
    """What the air holds; coefficients per metre at density 1.

    Raises:
        OptionError: a value outside its range. InputError: a density that is not (D,H,W), or is negative.
    """

    scattering: Tensor  # (3,) 1/m
    absorption: Tensor  # (3,) 1/m
    asymmetry: float = 0.0  # Henyey-Greenstein g
    density: Tensor | None = None  # (D,H,W) over the room: z, y, x; None: the same everywhere

    def __post_init__(self) -> None:
        for name in ("scattering", "absorption"):
            value = as_vector(name, getattr(self, name))
            object.__setattr__(self, name, value)
            check_range(name, float(value.min()), 0.0, LARGEST_EXTINCTION)
            check_range(name, float(value.max()), 0.0, LARGEST_EXTINCTION)
        check_range("asymmetry", self.asymmetry, -0.9, 0.9)
        if self.density is not None:
            if not isinstance(self.density, Tensor) or self.density.dim() != 3 or not self.density.numel():
                raise InputError(f"density must be a tensor (D, H, W), got {getattr(self.density, 'shape', None)}")
            check_finite("density", self.density)
            if bool((self.density < 0).any()):
                raise InputError("density must not be negative")

    @classmethod
    def of(
        cls,
        *,
        visibility: float | None = None,
        scattering: object = None,
        absorption: object = 0.0,
        asymmetry: float = 0.0,
        density: Tensor | None = None,
    ) -> FogMedium:
        """From a visibility in metres (``kappa = 3.912 / visibility``; what absorption leaves scatters), or from
        coefficients.

        Raises:
            OptionError: both or neither, a visibility outside [0.2, 1e6] m, or one that absorption alone exceeds.
        """
        absorbed = as_vector("absorption", absorption)  # type: ignore[arg-type]
        if (visibility is None) == (scattering is None):
            raise OptionError("a medium needs either visibility or scattering")
        if visibility is None:
            scattered = as_vector("scattering", scattering)  # type: ignore[arg-type]
        else:
            check_range("visibility", visibility, 0.2, 1e6)
            scattered = CONTRAST / visibility - absorbed
            if bool((scattered < 0).any()):
                raise OptionError(
                    f"absorption must be at most 3.912 / visibility, {CONTRAST / visibility:g}, got {absorbed.tolist()}"
                )
        return cls(scattering=scattered, absorption=absorbed, asymmetry=asymmetry, density=density)

    @property
    def extinction(self) -> Tensor:
        """(3,) absorption and scattering together, 1/m."""
        return self.absorption + self.scattering

    @property
    def visibility(self) -> float:
        """Metres, of green light; +inf in clear air."""
        kappa = float(self.extinction[1])
        return CONTRAST / kappa if kappa > 0 else float("inf")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class FogOptions:
    """How fog is put into a photo.

    ``transmittance``, of light on its way to a surface indoors: "centroid" of each light, "patches" of large ones, or
    the "ratio" of irradiance with and without the medium along the same random paths, bounces included.

    ``loss``, of daylight in a layer of fog outdoors: "single" as the source has it, all that is scattered is lost, so
    that it is night under a hundred metres of dense fog; "absorbed", what is scattered still arrives, from all sides
    the more the thicker the layer is; "none", and the layer is lit from above alone.

    Raises:
        OptionError: a value outside its range; names it.
    """

    transmittance: str = "ratio"
    steps: int = 48  # along a ray of sight
    light_samples: int = 16  # of each area light, for the light in the air; rounded up to a square
    patch_limit: float = 0.2  # extinction times a light's diameter beyond which it is split
    columns: int = 40  # of rays of sight along which the air's light is known, across the picture
    paths: int = 48  # random paths to each place of which the ratio is known
    bounces: int = 4  # of these paths
    angle_weight: float = 1.0  # of the sun's direction: of marked directions
    iou_weight: float = 1.0  # and of overlap with the lit floor
    albedo: float = 0.2  # of the ground outdoors
    scale: float = 1.0  # radiance of a white pixel
    top: float = 100.0  # metres: height of outdoor fog above the ground
    light_gain: float = 1.0  # lights are so much brighter than estimated
    shaft_gain: float = 1.0  # indoors: the sun is so much brighter than that
    attenuated_light: bool = True  # indoors: fog dims light on its way to what it lights
    loss: str = "absorbed"  # outdoors: what light loses on its way down through the layer
    ambient: bool = True  # indoors: light that comes from everywhere is fitted, too
    ground_bounce: bool = False  # outdoors: the ground lights the fog from below
    highlights: float = 1.0  # factor of saturated light sources: 2 recovers some of what the camera cut off
    matte_px: int = 2  # width of soft edges between sky and the rest
    curve: str = "srgb"  # of encoded photos
    gamma: float = 2.2
    seed: int = 0

    def __post_init__(self) -> None:
        check_choice("transmittance", self.transmittance, TRANSMITTANCES)
        check_choice("loss", self.loss, LOSSES)
        check_choice("curve", self.curve, CURVES)
        limits = {
            "steps": (8, 512), "light_samples": (1, 256), "patch_limit": (0.05, 1.0), "columns": (8, 512),
            "paths": (4, 4096), "bounces": (0, 16), "angle_weight": (0.0, 1e6), "iou_weight": (0.0, 1e6),
            "albedo": (0.02, 0.9), "scale": (0.1, 10.0), "top": (2.0, 2000.0), "light_gain": (0.1, 10.0),
            "shaft_gain": (0.0, 100.0),
            "highlights": (1.0, 16.0), "matte_px": (0, 16), "gamma": (0.5, 5.0), "seed": (0, 2**31 - 1),
        }  # fmt: skip
        for name, (low, high) in limits.items():
            check_range(name, getattr(self, name), low, high)
        if self.angle_weight == 0 and self.iou_weight == 0:
            raise OptionError("angle_weight and iou_weight must not both be 0")


def decoded(codes: Tensor, options: FogOptions) -> Tensor:
    """Linear light of encoded values in [0,1], by the curve of the options."""
    from torchrender.numerics.color import linear_from_srgb

    if options.curve == "srgb":
        return linear_from_srgb(codes)
    return codes if options.curve == "linear" else codes.clamp_min(0.0) ** options.gamma


def encoded(light: Tensor, options: FogOptions) -> Tensor:
    """The inverse of :func:`decoded`."""
    from torchrender.numerics.color import srgb_from_linear

    if options.curve == "srgb":
        return srgb_from_linear(light)
    return light if options.curve == "linear" else light.clamp_min(0.0) ** (1.0 / options.gamma)


def clear_air() -> FogMedium:
    """A medium that does nothing."""
    return FogMedium(scattering=torch.zeros(3), absorption=torch.zeros(3))
