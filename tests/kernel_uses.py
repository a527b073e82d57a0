"""Which kernels are called with which types, by running what the package and the service do, small.

``python tests/kernel_uses.py --write`` compiles everything in an empty folder and writes
``torchrender/data/kernels.json``, which ``torchrender warm-up`` compiles from; ``tests/kernels/test_signatures.py``
runs the same work and compares. ``--keep-more`` leaves out what takes most of that, other settings than the usual ones,
and keeps what was recorded of them. ``--seconds`` measures again how long what is recorded takes to compile.
``--check`` warms up in an empty folder, does all of the work, and fails if anything is compiled then.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

Key = tuple[str, str]  # kernel and its types as JSON
SIDE = 48
MORE = ".more"
FILES = "torchrender.scene.files."


class Recorder:
    """Notes every call of a kernel from Python."""

    def __init__(self) -> None:
        self.parts: dict[Key, set[str]] = {}
        self.seconds: dict[Key, float] = {}
        self.group = "render"
        self.suffix = ""

    @contextmanager
    def listening(self) -> Iterator[None]:
        """In here; nothing is compiled side by side, so that all seconds are those of this process."""
        from numba.core.registry import CPUDispatcher

        from torchrender.cli.warm_up import ColdStart
        from torchrender.kernels.compile import Kernel
        from torchrender.kernels.shading import needs
        from torchrender.kernels.stages import Stage

        plain, compiling = CPUDispatcher.__call__, Kernel.compile

        def call(kernel: Any, *arguments: Any, **named: Any) -> Any:
            self._note(kernel, arguments, named)
            return plain(kernel, *arguments, **named)

        def compile_timed(kernel: Any, signature: Any) -> Any:
            begin = time.process_time()
            made = compiling(kernel, signature)
            if kernel._seen and isinstance(signature, tuple):
                with_types = self._key(kernel, signature)
                self.seconds.setdefault(with_types, time.process_time() - begin)
            return made

        finding, keeping = Stage.address, needs._compiled

        def address(stage: Any, *kinds: Any) -> int:
            where = self._where()
            if stage.need is not None and self.group == "render":
                where = {f"render.shading.{stage.need}{self.suffix}"}
            self.parts.setdefault(self._key(stage, kinds), set()).update(where)
            return finding(stage, *kinds)

        Stage.address, needs._compiled = address, keeping.__wrapped__  # asked for every picture
        asking, beginning = ColdStart.__call__, ColdStart.begin
        Kernel.__call__, Kernel.compile = call, compile_timed
        ColdStart.__call__, ColdStart.begin = lambda *_: False, lambda _: None
        try:
            yield
        finally:
            del Kernel.__call__
            Kernel.compile = compiling
            Stage.address, needs._compiled = finding, keeping
            ColdStart.__call__, ColdStart.begin = asking, beginning

    def run(self, group: str, work: Callable[[], Any], suffix: str = "") -> None:
        """Do this and note what it calls for ``group``."""
        self.group, self.suffix = group, suffix
        work()

    def _note(self, kernel: Any, arguments: tuple[Any, ...], named: dict[str, Any]) -> None:
        from numba.core import types

        kinds = [kernel.typeof_pyval(one) for one in arguments]
        folded = kernel._compiler.fold_argument_types(
            tuple(kinds), {name: kernel.typeof_pyval(one) for name, one in named.items()}
        )[1]
        kinds = [types.Omitted(k.value) if isinstance(k, types.Omitted) else k for k in folded]
        self.parts.setdefault(self._key(kernel, tuple(kinds)), set()).update(self._where())

    @staticmethod
    def _key(kernel: Any, kinds: tuple[Any, ...]) -> Key:
        from torchrender.kernels.signatures import described

        return kernel.kernel_name, json.dumps([described(one) for one in kinds])

    def _where(self) -> set[str]:
        """The parts of what is being done; in a picture the passes that run."""
        if self.group != "render":
            return {self.group + self.suffix}
        found, here = set(), threading.main_thread().ident
        # A pass waits for threads that it has started.
        frame = sys._getframe(2) if threading.get_ident() == here else sys._current_frames().get(here or 0)
        while frame is not None:
            name = frame.f_globals.get("__name__", "")
            if name.startswith("torchrender.passes.") and name.count(".") == 3:
                found.add(f"render.{name.rpartition('.')[2]}{self.suffix}")
            if name.startswith(FILES):
                found.add(f"render.files{self.suffix}")
            frame = frame.f_back
        return found or {f"render.any{self.suffix}"}


def scenes() -> Iterator[Any]:
    """The built-in scenes, as small as they can be."""
    from torchrender.scene.load import load
    from torchrender.scene.procedural import SCENES

    for name, builder in SCENES.items():
        yield load(name, size=builder.fewest)


def glb_scene(folder: Path) -> Any:
    """Two triangles of a GLB file without normals: what ``render x.glb`` meets."""
    from gltf_builder import Glb
    from torchrender.scene.load import load

    made = Glb(materials=[{"pbrMetallicRoughness": {"metallicFactor": 0.0}}], nodes=[{"mesh": 0}])
    made.mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.2]], [[0, 1, 2], [1, 3, 2]], material=0)
    (folder / "two.glb").write_bytes(made.bytes())
    return load(folder / "two.glb")


def default_pictures() -> None:
    """What ``torchrender render`` does without options, and ``make demo``."""
    from shading_scenes import LIGHTS, scene_of_all, views
    from torchrender.pipeline.options import RenderOptions
    from torchrender.renderer import render

    for scene in scenes():
        render(scene, width=SIDE, height=SIDE)
    with tempfile.TemporaryDirectory() as folder:
        render(glb_scene(Path(folder)), width=SIDE, height=SIDE)
    render("living_room", width=SIDE, height=SIDE, options=RenderOptions(supersample=2.0))
    scene = scene_of_all(*LIGHTS)
    render(scene, views(SIDE, SIDE))


def all_pictures() -> None:
    """Every setting of every pass, budgets, sequences, batches and other cameras."""
    import torch

    from torchrender.passes.table import PASSES
    from torchrender.pipeline.history import RenderHistory
    from torchrender.pipeline.options import AREA_SHADOWS, POINT_SHADOWS, REFLECTIONS, UPSCALING, RenderOptions
    from torchrender.raster import rasterize
    from torchrender.renderer import render
    from torchrender.scene.camera import Cameras

    plain = RenderOptions()
    choices = [setting.applied(p.settings.context.applied(plain)) for p in PASSES for setting in p.settings.all]
    choices += [p.settings.reference.applied(p.settings.context.applied(plain)) for p in PASSES]
    choices += [replace(plain, reflections=one) for one in REFLECTIONS]
    choices += [replace(plain, point_shadows=one) for one in POINT_SHADOWS]
    choices += [replace(plain, area_shadows=one) for one in AREA_SHADOWS]
    choices += [replace(plain, upscaling=one, supersample=0.5) for one in UPSCALING]
    choices += [replace(plain, shadows=False), replace(plain, supersample=1.5)]
    fewer: list[RenderOptions] = []
    for one in choices:
        one = replace(one, supersample=min(one.supersample, 2.0))
        if one not in fewer:
            fewer.append(one)
    for scene in scenes():
        for options in fewer:
            render(scene, width=SIDE, height=SIDE, options=options)
        render(scene, width=SIDE, height=SIDE, budget_ms=50.0)
        history: RenderHistory | None = RenderHistory()
        camera = scene.camera(width=SIDE, height=SIDE)
        for _ in range(3):
            history = render(scene, camera, history=history).history
        shift = torch.eye(4, dtype=torch.float64)
        shift[0, 3] = 0.01 * scene.diagonal
        for _ in range(3):
            scene = scene.moved(scene.meshes[-1].name, shift)
            history = render(scene, camera, history=history).history
        rasterize(scene, Cameras.cat([camera] * 16), outputs=("depth", "normal", "object_id"))


def depth_images() -> None:
    """What ``torchrender depth`` does."""
    from torchrender.depth.kinds import sample_kinds
    from torchrender.depth.options import SamplingOptions
    from torchrender.depth.sample import sample_depth_images
    from torchrender.depth.viewpoints import viewpoints_around
    from torchrender.scene.load import load

    scene = load("cornell_box")
    cameras = viewpoints_around(scene, scene.camera(width=SIDE, height=SIDE), 3)
    for method in ("nonredundant", "conventional", "depth_peeling"):
        for redundancy in ("pixel", "visibility"):
            images = sample_depth_images(scene, cameras, SamplingOptions(method=method, redundancy=redundancy))
    sample_kinds(scene, cameras, images)


def points() -> None:
    """What ``torchrender points`` does."""
    from torchrender.cli.main import main

    with tempfile.TemporaryDirectory() as folder:
        small = ["--samples", "3000"]
        packed = str(Path(folder) / "p.trp")
        _run(main, "points", "tree", "-o", packed, *small)
        size = ["--size", f"{SIDE}x{SIDE}"]
        for kind in ("adaptive", "full", "reconstruction", "low_pass", "squares"):
            for cloud, more in (("tree", small), (packed, [])):
                _run(main, "points", cloud, "-o", str(Path(folder) / "p.png"), "--filter", kind, *more, *size)
                _run(main, "points", cloud, "-o", str(Path(folder) / "p.exr"), "--two-sided", *more, *size)


def voxels() -> None:
    """What ``torchrender voxelize`` does."""
    from torchrender.cli.main import main

    with tempfile.TemporaryDirectory() as folder:
        small = ["--resolution", "24"]
        size = ["--size", f"{SIDE}x{SIDE}"]
        for more in ([], ["--thin"], ["--solid"], *(["--solid", "--method", m] for m in ("parity", "vote", "soup"))):
            for scene in ("cornell_box", "tree"):
                _run(main, "voxelize", scene, "-o", str(Path(folder) / "v.npz"), *small, *more)
                for look in ([], ["--transparent"]):
                    _run(main, "voxelize", scene, "-o", str(Path(folder) / "v.png"), *small, *more, *look, *size)


FIRST_KEYFRAMES = ("living_room", "washroom")
QUICK_MS = 150.0
"""With so much time a keyframe is made as a quicker machine makes it in the usual time."""
"""Scenes whose first keyframes need what those of every stream need, and little else: shadows by maps."""


def first_keyframes() -> None:
    """What a renderer does for a stream until it has sent the first keyframe."""
    for scene in scenes():
        if scene.name in FIRST_KEYFRAMES:
            for budget in (None, QUICK_MS):
                _stream(scene, [(budget, False)])


def streams() -> None:
    """What a renderer does for a stream: keyframes while the view moves and rests, extra layers, smoother pictures."""
    for scene in scenes():
        _stream(scene, [(None, False), (10.0, True), (None, False), (None, True), (1000.0, False), (1000.0, True)])


def _stream(scene: Any, keyframes: list[tuple[float | None, bool]]) -> None:
    """Keyframes with these budgets, moving or still, and what follows each of them."""
    from torchrender.wire.cameras import header_of
    from torchrender_service.renderers.jobs import Bounds, MakeKeyframe, MakeLayers, SceneSource, SmoothKeyframe
    from torchrender_service.renderers.streaming.stream_renderer import StreamRenderer

    renderer = StreamRenderer()
    for number, (budget, still) in enumerate(keyframes):
        job = MakeKeyframe(
            session="s", scene=SceneSource(id="x"), id=number, pose=number, time_ms=0.0,
            camera=header_of(scene.camera(width=64, height=48)), still=still, extra_layers=2,
            direction=(0.0, 0.0, 0.0), baseline=0.0, color="jpeg", quality=85, bounds=Bounds(budget_ms=budget),
        )  # fmt: skip
        renderer.make(scene, job)
        renderer.make_layers(MakeLayers(session="s", id=number))
        while job.still and renderer.smooth(SmoothKeyframe(session="s", id=number)).get("left"):
            pass


def _run(main: Callable[[list[str]], int], *words: str) -> None:
    assert main(list(words)) == 0, words


WORK: tuple[tuple[str, Callable[[], Any], str], ...] = (
    ("render", default_pictures, ""),
    ("depth", depth_images, ""),
    ("serve", first_keyframes, ".first"),
    ("serve", streams, ".rest"),
    ("points", points, ""),
    ("voxels", voxels, ""),
    ("render", all_pictures, ".more"),
)


def record(only: tuple[str, ...] = ()) -> Recorder:
    """Do all of the work, or the functions of these names."""
    recorder = Recorder()
    with recorder.listening():
        for group, work, suffix in WORK:
            if not only or work.__name__ in only:
                recorder.run(group, work, suffix)
    return recorder


def write(path: Path, *, keep_more: bool = False) -> int:
    """Record with nothing compiled; the number of kernels with types.

    Args:
        keep_more: leave out the work that takes longest, all settings of all pictures; what only it needs stays as it
            was recorded, as far as there still are such kernels.
    """
    recorder = record(tuple(work.__name__ for _, work, suffix in WORK if suffix != MORE) if keep_more else ())
    for row in json.loads(path.read_text())["kernels"] if keep_more else ():
        key, more = (row["kernel"], json.dumps(row["types"])), {one for one in row["parts"] if one.endswith(MORE)}
        if more and (key in recorder.parts or _takes(row["kernel"], row["types"])):
            recorder.parts.setdefault(key, set()).update(more)
            recorder.seconds.setdefault(key, row["seconds"])
    rows = [
        {
            "kernel": kernel,
            "seconds": round(recorder.seconds.get((kernel, kinds), 0.1), 2),
            "parts": sorted(parts),
            "types": json.loads(kinds),
        }
        for (kernel, kinds), parts in sorted(recorder.parts.items())
    ]
    return _put(path, rows)


def _takes(name: str, told: list[Any]) -> bool:
    """Whether there is a kernel of that name with so many arguments, and their records have the fields they had."""
    from torchrender.kernels.signatures import Use, kernel_of, types_of

    use = Use(name, json.dumps(told), 0.0, ())
    try:
        return bool(kernel_of(use).py_func.__code__.co_argcount == len(types_of(use)))
    except (ImportError, AttributeError, TypeError):
        return False


def write_seconds(path: Path) -> int:
    """Compile what is recorded, with nothing compiled before, and note how long each took: who begins with the longest
    ends earlier.
    """
    from torchrender.kernels.signatures import Use, kernel_of, types_of

    rows = json.loads(path.read_text())["kernels"]
    for row in rows:
        use = Use(row["kernel"], json.dumps(row["types"]), 0.0, ())
        kernel = kernel_of(use)
        getattr(sys.modules[kernel.py_func.__module__], "load_library", bool)()
        begin = time.process_time()
        kernel.compile(types_of(use))
        row["seconds"] = round(time.process_time() - begin, 2)
    return _put(path, rows)


def _put(path: Path, rows: list[dict[str, Any]]) -> int:
    lines = [json.dumps({key: row[key] for key in ("kernel", "seconds", "parts", "types")}) for row in rows]
    path.write_text('{"kernels": [\n' + ",\n".join(lines) + "\n]}\n")
    return len(rows)


@contextmanager
def compiled() -> Iterator[list[str]]:
    """Names of what is compiled in here, helpers included, and not read from disk."""
    from numba.core import event

    names: list[str] = []

    class Listener(event.Listener):
        def on_start(self, found: Any) -> None:
            names.append(found.data["dispatcher"].py_func.__qualname__)

        def on_end(self, found: Any) -> None:
            pass

    listener = Listener()
    event.register("numba:compile", listener)
    try:
        yield names
    finally:
        event.unregister("numba:compile", listener)


def check() -> int:
    """Warm up with nothing compiled, then do all of the work; the number of functions compiled after the warm-up."""
    from torchrender.cli.warm_up import Bar
    from torchrender.kernels.warm_up import missing, warm_up

    outcome = warm_up(missing(), Bar())
    late = len(outcome.failed)
    for group, work, suffix in WORK:
        with compiled() as names:
            work()
        late += len(names)
        sys.stdout.write(f"{group}{suffix} {work.__name__}: {', '.join(names) or 'nothing'} compiled\n")
    sys.stdout.write(f"{outcome.compiled} kernels compiled before, {late} functions after the warm-up\n")
    return late


if __name__ == "__main__":
    if not {"--write", "--seconds", "--check"}.intersection(sys.argv):
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as empty:
        os.environ["NUMBA_CACHE_DIR"] = empty
        os.environ["TORCHRENDER_CURVES"] = os.devnull + "/none"
        if "--check" in sys.argv:
            sys.exit(check() > 0)
        from torchrender.kernels.signatures import RECORDED

        keep = "--keep-more" in sys.argv
        count = write_seconds(RECORDED) if "--seconds" in sys.argv else write(RECORDED, keep_more=keep)
        sys.stdout.write(f"{count} kernels with types\n")
