"""Which extensions of glTF are read, and what a file holds that is not."""

from __future__ import annotations

from collections import Counter
from typing import Any

COMPRESSION = {
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_texture_basisu",
    "EXT_texture_webp",
}

SUPPORTED = COMPRESSION | {
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "EXT_mesh_gpu_instancing",
}
"""Extensions whose content is read."""

SILENT = {"KHR_xmp", "KHR_xmp_json_ld", "AGI_articulations", "EXT_structural_metadata", "EXT_mesh_features"}
"""Descriptions that no picture shows."""

MAX_DEPTH = 64


def unused_extensions(document: Any) -> Counter[str]:
    """How often each extension stands in a document that is neither read nor a mere description."""
    found: Counter[str] = Counter()
    waiting = [(document, 0)]
    while waiting:
        value, depth = waiting.pop()
        if depth > MAX_DEPTH:
            continue
        if isinstance(value, list):
            if value and isinstance(value[0], dict | list):  # long lists of numbers hold no objects
                waiting += [(v, depth + 1) for v in value]
        elif isinstance(value, dict):
            extensions = value.get("extensions")
            if isinstance(extensions, dict):
                found.update(name for name in extensions if name not in SUPPORTED and name not in SILENT)
            waiting += [(v, depth + 1) for k, v in value.items() if k != "extras" and isinstance(v, dict | list)]
    return found
