"""The nodes of one scene of a glTF file: a forest with rest poses, and the instances that nodes place."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchrender.errors import InputError, SceneFileError
from torchrender.scene.files.gltf.accessors import Accessors
from torchrender.scene.files.gltf.container import Array, GltfFile, object_of
from torchrender.scene.motion.pose import transforms
from torchrender.scene.motion.records import Nodes

INSTANCING = "EXT_mesh_gpu_instancing"


def chosen_scene(file: GltfFile, subscene: str | int | None) -> tuple[list[Any], int | None]:
    """Numbers of the root nodes, and of the scene: of that name or number, else the default one; None without any.

    Raises:
        InputError: there is no such scene; the message lists those there are.
    """
    entries = file.entries("scenes")
    if not entries:
        if subscene is not None:
            raise InputError(f"there is no scene {subscene!r}; {file.path} names none")
        listed = [c for n in file.entries("nodes") if isinstance(n, dict) for c in _children(file, n)]
        children = {c for c in listed if isinstance(c, int)}
        return [k for k in range(len(file.entries("nodes"))) if k not in children], None
    names = [str(object_of(e).get("name", k)) for k, e in enumerate(entries)]
    number = file.json.get("scene", 0) if subscene is None else subscene
    if isinstance(number, str):
        if number not in names:
            raise InputError(f"there is no scene {number!r}; known: {', '.join(names)}")
        number = names.index(number)
    elif subscene is not None and not 0 <= number < len(names):
        raise InputError(f"there is no scene {number}; known: {', '.join(names)}")
    entry = file.item("scenes", number)
    others = [name for k, name in enumerate(names) if k != number]
    if others and subscene is None:
        file.notes.not_used(f"other scenes of the file: {', '.join(others)[:200]}", len(others))
    roots = entry.get("nodes", [])
    if not isinstance(roots, list):
        raise SceneFileError(file.path, "must be an array", key=f"scenes[{number}].nodes")
    return roots, number


def read_nodes(file: GltfFile, roots: list[Any]) -> tuple[Nodes, list[int]]:
    """All nodes of the file in their rest pose, and the numbers of those below ``roots``, parents first.

    Raises:
        SceneFileError: nodes that form no trees, or values that are no finite numbers.
    """
    entries = file.entries("nodes")
    count = len(entries)
    parents = np.full(count, -1, np.int64)
    waiting: list[tuple[Any, int]] = [(index, -1) for index in reversed(roots)]
    seen = np.zeros(count, bool)
    order: list[int] = []
    while waiting:
        index, parent = waiting.pop()
        node = file.item("nodes", index)
        if seen[index]:
            raise SceneFileError(file.path, "is reached twice; nodes must form trees", key=f"nodes[{index}]")
        seen[index] = True
        parents[index] = parent
        order.append(index)
        waiting += [(child, index) for child in reversed(_children(file, node, index))]
    translation, rotation, scale = np.zeros((count, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)), np.ones((count, 3))
    matrices: dict[int, Array] = {}
    for index in order:
        node, key = entries[index], f"nodes[{index}]"
        if "matrix" in node:
            identity = np.eye(4).reshape(-1).tolist()
            matrices[index] = file.numbers(node, "matrix", identity, key).reshape(4, 4).T
            continue
        for name, values in (("translation", translation), ("rotation", rotation), ("scale", scale)):
            if name in node:
                values[index] = file.numbers(node, name, values[index].tolist(), key)
    none = int((rotation == 0).all(1)[order].sum())
    file.notes.repaired("rotation of a node is zero, which is none: it is not turned", none)
    return Nodes(parents, translation, rotation, scale, matrices, _weights(file, order)), order


def _children(file: GltfFile, node: dict[str, Any], index: int = -1) -> list[Any]:
    children = node.get("children", [])
    if not isinstance(children, list):
        raise SceneFileError(file.path, "must be an array", key=f"nodes[{index}].children")
    return children


def _weights(file: GltfFile, order: list[int]) -> dict[int, Array]:
    """Weights of morph targets: those of the node, else of its mesh."""
    found = {}
    for index in order:
        node = file.item("nodes", index)
        if "mesh" not in node:
            continue
        holder, key = (node, f"nodes[{index}]") if "weights" in node else (file.item("meshes", node["mesh"]), "meshes")
        if "weights" in holder:
            given = holder["weights"]
            count = len(given) if isinstance(given, list) else 0
            found[index] = file.numbers(holder, "weights", [0.0] * count, key)
    return found


def instance_count(file: GltfFile, node: dict[str, Any]) -> int:
    """How often a node shows its mesh."""
    given = _instance_attributes(node)
    counts = [Accessors(file).count(a) for n, a in given.items() if n in ("TRANSLATION", "ROTATION", "SCALE")]
    return max(counts) if counts else 1


def instances(file: GltfFile, node: dict[str, Any], key: str) -> Array | None:
    """``node_from_instance`` (I,4,4) of EXT_mesh_gpu_instancing; None where the node does not have it.

    Raises:
        SceneFileError: attributes of different lengths, or of wrong types.
    """
    given = _instance_attributes(node)
    if not given:
        return None
    accessors, key = Accessors(file), f"{key}.extensions.{INSTANCING}"
    kinds = {"TRANSLATION": ("VEC3",), "ROTATION": ("VEC4",), "SCALE": ("VEC3",)}
    found = {n: accessors.read(given[n], k, f"{key}.{n}").astype(np.float64) for n, k in kinds.items() if n in given}
    for name in given:
        if name not in kinds:
            file.notes.not_used(f"instance attribute {name}")
    if not found:
        return None
    counts = {len(v) for v in found.values()}
    if len(counts) > 1:
        raise SceneFileError(file.path, "attributes have different numbers of instances", key=key)
    count = counts.pop()
    return transforms(
        found.get("TRANSLATION", np.zeros((count, 3))),
        found.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))),
        found.get("SCALE", np.ones((count, 3))),
    )


def _instance_attributes(node: dict[str, Any]) -> dict[str, Any]:
    return object_of(object_of(object_of(node.get("extensions")).get(INSTANCING)).get("attributes"))
