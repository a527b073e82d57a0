"""How a picture is enhanced."""

from __future__ import annotations

from dataclasses import dataclass

from torchrender.checks import check_choice, check_range, checked_fields
from torchrender.errors import OptionError

MAGNITUDES = ("signed_l2", "sum", "l1", "l2")
TERMS = ("geometry", "projection", "visibility", "specular")
CURVATURES = ("scaled", "full")
SOURCES = ("auto", "mesh", "picture")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class EnhanceOptions:
    """Gradient-enhanced rendering; the defaults are the source's, but for a magnitude without its diagonal bias.

    The picture becomes ``plain_weight I + gradient_weight mag(grad I)``.

    Raises:
        OptionError: a value outside its range; names it.
    """

    plain_weight: float = 0.8  # lambda 1: below one, so that enhanced ridges are not clipped
    gradient_weight: float = 0.4  # lambda 2; negative turns ridges dark
    exponent: float = 1.0  # alpha of the strength S(k): above one only extremes are enhanced
    centred: bool = False  # curvature counts from the median of its mesh: what is round all over stays as bright
    limit: float | None = None  # beta, 1/unit: curvature from which on S is one; None: 95th percentile of |k|
    magnitude: str = "signed_l2"  # "sum" of both components as published, biased to one diagonal; "l1", "l2" unsigned
    terms: tuple[str, ...] = ("geometry", "projection")  # of TERMS; without projection every face counts as frontal
    curvature: str = "scaled"  # "scaled": S(k) in place of the normal's derivative; "full": that derivative
    step: float = 0.02  # image distance, in focal lengths, that true derivatives (full, visibility) are carried along
    light_gradient: bool = True  # the light's direction changes over the surface, too (not in "signed_l2")
    source: str = "auto"  # curvature of the "mesh", of the "picture", or of the mesh where it has vertex normals
    grazing: float = 0.05  # least cosine of the angle of view that projection divides by
    shadow_sharpness: float | None = None  # k of the smooth shadow step, 1/unit; None: 1.5 / median width of an edge
    shadow_blur: float = 1.5  # standard deviation, pixels, that the gradient of shadows is blurred by
    overshoot_limit: float | None = (
        None  # beside creases, of the largest change there: 1/3 keeps contrast from flipping
    )
    range_limit: float | None = None  # share that the local range may be exceeded by: keeps edges from flipping

    def __post_init__(self) -> None:
        check_range("plain_weight", self.plain_weight, 0.0, 1.5)
        check_range("gradient_weight", self.gradient_weight, -1.0, 2.0)
        check_range("exponent", self.exponent, 0.1, 5.0)
        check_range("step", self.step, 0.0, 10.0)
        check_range("grazing", self.grazing, 0.01, 0.2)
        check_range("shadow_blur", self.shadow_blur, 0.0, 5.0)
        if self.overshoot_limit is not None:
            check_range("overshoot_limit", self.overshoot_limit, 0.0, 1.0)
        for name in ("limit", "shadow_sharpness", "range_limit"):
            if getattr(self, name) is not None:
                check_range(name, getattr(self, name), 0.0, 1e12)
        check_choice("magnitude", self.magnitude, MAGNITUDES)
        check_choice("curvature", self.curvature, CURVATURES)
        check_choice("source", self.source, SOURCES)
        if not self.terms:
            raise OptionError(f"terms must name at least one of {', '.join(TERMS)}, got none")
        for term in self.terms:
            check_choice("terms", term, TERMS)
        if self.magnitude == "signed_l2" and self.curvature == "full":
            raise OptionError("magnitude must not be signed_l2 with curvature full: the sign is that of S(k)")
