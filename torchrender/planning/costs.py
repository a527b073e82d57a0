"""What is known about a picture's costs: times and errors of its passes at their settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from torchrender.passes.contract import Amounts, Buffers, Pass
from torchrender.passes.outlook import Outlook
from torchrender.passes.senses import beside, closely, roughly
from torchrender.passes.table import PASSES, PICTURE, table_of
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import Pace
from torchrender.planning.curves import Curves, scene_key
from torchrender.planning.foresight import Expected
from torchrender.planning.graph import Graph, resolve
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

SENSE = "sense of "
"""Begin of the names of what passes sense."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Knowledge:
    """What the planner knows about a picture."""

    outlook: Outlook  # its options are those that were wished for
    curves: Curves
    passes: tuple[Pass, ...] = PASSES
    wanted: Buffers = (PICTURE,)
    given: Buffers = ()
    ahead: Buffers = ()  # that last, made for pictures to come
    name: str = field(default="", repr=False)  # under which the scene was measured
    _last: list[tuple[RenderOptions, Graph]] = field(init=False, default_factory=list, repr=False)

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", scene_key(self.outlook.scene))

    @classmethod
    def of(
        cls,
        scene: Scene,
        cameras: Cameras,
        options: RenderOptions,
        history: RenderHistory | None,
        curves: Curves,
    ) -> Knowledge:
        """Before a picture of a scene as it was given; without a history it is one alone."""
        passes = table_of(options)
        past = (RenderHistory.alone() if history is None else history).of_scene(scene)
        outlook = Outlook(scene=past.scene or scene, cameras=cameras, options=options, history=past)
        known = {buffer.name: buffer for step in passes for buffer in step.makes_all}
        asked = tuple(known[name] for name in options.buffers if name in known)
        found = cls(outlook=outlook, curves=curves, passes=passes, wanted=(PICTURE, *asked))
        return found._elsewhere() if past.leaps_to(cameras) and found.unseen else found

    def _elsewhere(self) -> Knowledge:
        """Without what was sensed from where the eye was, and what was chosen by that."""
        past, pace = self.outlook.history, self.pace
        known = {name: value for name, value in pace.known.items() if not name.startswith(SENSE)}
        past = replace(past, pace=replace(pace, known=known, search=None, hunt=None))
        return replace(self, outlook=replace(self.outlook, history=past))

    @property
    def asked(self) -> Buffers:
        """What this picture is to make."""
        return (*self.wanted, *self.ahead)

    @property
    def pace(self) -> Pace:
        """What the sequence's pictures took so far."""
        return self.outlook.history.pace or Pace()

    def found_out(self, **known: float) -> Knowledge:
        """With quantities that a pass found out."""
        outlook = replace(self.outlook, known={**self.outlook.known, **known})
        return replace(self, outlook=outlook)

    def graph(self, options: RenderOptions) -> Graph:
        """Which passes run with these options; the last answer is kept, for plans and runs ask for it one by one."""
        if not self._last or self._last[0][0] is not options:
            self._last[:] = [(options, resolve(self.passes, self.outlook.at(options), self.asked, self.given))]
        return self._last[0][1]

    def predicted_ms(self, step: Pass, setting: str, amounts: Amounts) -> float | None:
        """Time of one pass at one setting for this much work; None if it was never measured."""
        usual = self.curves.time_ms(step.name, setting, amounts, self.name)
        if usual is None or not step.did_once(amounts):
            return None if usual is None else usual * self.pace.ratio(step.name, setting)
        each = self.curves.time_ms(step.name, setting, step.again(amounts), self.name) or 0.0
        # What is done once, sequences do not learn: it takes as much longer as all passes together.
        return (usual - each) * self.pace.speed + each * self.pace.ratio(step.name, setting)

    @property
    def unseen(self) -> bool:
        """The scene is none of those that were measured, or the picture much smaller or larger than theirs were."""
        return self.name not in self.curves.scenes or not self.curves.like_measured(self.outlook.cameras)

    @property
    def blind(self) -> bool:
        """The picture is like none of those that were measured, and no other one of its scene, from about there, told
        what its errors follow."""
        return self.unseen and not any(name.startswith(SENSE) for name in self.pace.known)

    def setting_error(self, step: Pass, setting: str, options: RenderOptions) -> Expected:
        """Error of a setting; where settings are compared in a context of their own, beyond the best of them.

        A pass that knows one way has none. It is what the setting adds to the whole picture's.
        """
        if not step.settings.is_choice or not step.settings.shows(options):
            return Expected(0.0, 0.0)
        found = self._error(step, setting)
        if step.settings.context.changes:
            best = min(self._error(step, s).error for s in step.settings.names)
            found = found._replace(error=max(found.error - best, 0.0))
        factor = self.curves.joint(options).factor if self.unseen else self.curves.own_factor(self.name)
        if setting in step.patterns or (self.unseen and setting != step.off):
            factor *= coarsening(step, options)
        return found if factor == 1.0 else found._replace(error=min(factor * found.error, 1.0))

    def leaves_out(self, step: Pass, options: RenderOptions) -> bool:
        """The pass was asked for and has something to do, and these options turn it off: that is an error, too."""
        if step.off is None or step.settings.current(options) != step.off:
            return False
        asked = step.settings.current(self.outlook.options) != step.off
        return asked and step.applies(self.outlook.at(step.settings.reference.applied(options))).runs

    def _error(self, step: Pass, setting: str) -> Expected:
        known = self.pace.known
        probed, sensed = known.get(sense_of(closely(step.name))), _sensed(known, step.name)
        scene = None if self.unseen else self.name
        found = self.curves.error(step.name, setting, scene, sensed, probed)
        if probed is None or setting != step.off:
            return found
        # Where a probe finds nothing uncertain, leaving all of it out may still change everything.
        return max(found, self.curves.error(step.name, setting, scene, sensed), key=lambda one: one.error)


def _sensed(known: Mapping[str, float], name: str) -> float | None:
    """What a pass senses; where later pictures left it out, as much more as is roughly seen to have come since."""
    own, rough = known.get(sense_of(name)), known.get(sense_of(roughly(name)))
    if own is None or rough is None:
        return rough if own is None else own
    return own + max(rough - known.get(sense_of(beside(name)), rough), 0.0)


def sense_of(name: str) -> str:
    """The quantity that a pass of that name senses: its errors follow it."""
    return SENSE + name


def coarsening(step: Pass, options: RenderOptions) -> float:
    """Times by which errors of a pass grow that looks from some rendered pixels only, where these are few."""
    return float(min(options.supersample, 1.0) ** -step.coarsens)


def is_seen(step: Pass, graph: Graph) -> bool:
    """The pass's setting shows: what lasts does only where the picture itself asks for it."""
    if step.makes.lasting is None:
        return True
    return any(asker.lasting is None for asker in graph.asked.get(step.makes, ()))
