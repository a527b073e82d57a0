"""What is to choose for a budget or an error bound: open settings, times, errors, and how passes depend on each other.

Passes depend on each other's settings in three ways only: a setting asks for a buffer that others do not ask for, what
an earlier picture left holds at some settings, and a pass applies at some. Settings of a pass that are alike in all of
this form a class. For every choice of a class per pass, a *mode*, it is settled which passes run and what shows; what
is left to choose inside a mode are independent settings whose times, and errors to the power of the norm, add up.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product

from torchrender.passes.contract import Buffers, Pass
from torchrender.passes.outlook import Outlook
from torchrender.passes.settings import CUSTOM, Setting
from torchrender.pipeline.buffer import same
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.costs import Knowledge
from torchrender.planning.graph import AnyBuffer, layers

Combination = Mapping[str, str]
"""A setting for every pass with open settings, by its name."""


@dataclass(frozen=True, eq=False)
class Alike:
    """Settings of one pass that ask for the same, and at which the same holds and applies."""

    settings: tuple[str, ...]
    inputs: Buffers
    holds: frozenset[Hashable]  # lasting buffers and passes that are lost at these settings


@dataclass(frozen=True, eq=False)
class Mode:
    """A class for every pass: who runs, and for whom a fresh start is needed."""

    classes: Mapping[str, Alike]
    running: tuple[Pass, ...]
    seen: frozenset[str]  # passes whose error shows
    fresh: frozenset[str]  # passes that cannot go on from what an earlier picture left


@dataclass(frozen=True, eq=False, kw_only=True)
class Question:
    """Open settings of the passes of a picture. The first pass sets the number of pixels, which all times follow."""

    knowledge: Knowledge
    options: RenderOptions  # as they stand
    open: Mapping[str, tuple[Setting, ...]]  # by pass
    done: frozenset[str]  # passes that ran: their time is spent
    _times: dict[tuple[str, str, str, bool], float] = field(default_factory=dict, repr=False)
    _errors: dict[tuple[str, str, str], float] = field(default_factory=dict, repr=False)

    @classmethod
    def about(cls, knowledge: Knowledge, options: RenderOptions, done: frozenset[str] = frozenset()) -> Question:
        """All settings are open but those of passes that ran, are held, or stand where no setting is."""
        open_ = {}
        for step in knowledge.passes:
            current = step.settings.current(options)
            if current == CUSTOM:
                continue
            held = step.name in done or step.name in options.fixed
            open_[step.name] = (step.settings.named(current),) if held else step.settings.all
        return cls(knowledge=knowledge, options=options, open=open_, done=done)

    def options_at(self, combination: Combination) -> RenderOptions:
        """The options with these settings."""
        options = self.options
        for step in self.knowledge.passes:
            if step.name in combination:
                options = step.settings.named(combination[step.name]).applied(options)
        return options

    @property
    def counts(self) -> tuple[Setting, ...]:
        """Settings of the first pass: numbers of rendered pixels."""
        first = self.knowledge.passes[0]
        return self.open.get(first.name, (Setting(CUSTOM, {}),))

    # ------------------------------------------------------------ times, errors

    def time_ms(self, step: Pass, setting: str, count: Setting, fresh: bool) -> float:
        """Of one pass at one setting and number of pixels; 0 where it ran already or was never measured."""
        if step.name in self.done:
            return 0.0
        key = (step.name, setting, count.name, fresh)
        if key not in self._times:
            options = count.applied(self._exact_at(step, setting))
            outlook = self.knowledge.outlook.at(options)
            if step.makes.lasting is not None:
                outlook = self._with_or_without(outlook, step, fresh)
            self._times[key] = self.knowledge.predicted_ms(step, setting, step.amounts(outlook)) or 0.0
        return self._times[key]

    def error(self, step: Pass, setting: str, count: Setting) -> float:
        """Of one pass at one setting, to the power of the norm."""
        key = (step.name, setting, count.name)
        if key not in self._errors:
            options = count.applied(self.options)
            self._errors[key] = self.knowledge.setting_error(step, setting, options) ** self.knowledge.curves.norm
        return self._errors[key]

    def _with_or_without(self, outlook: Outlook, step: Pass, fresh: bool) -> Outlook:
        """As if what the pass makes was kept, or was not."""
        kept = outlook.history.kept.get(step.makes.name)
        if not fresh and kept is not None:
            return outlook.at(kept.settings)
        rest = {name: one for name, one in outlook.history.kept.items() if name != step.makes.name}
        return replace(outlook, history=replace(outlook.history, kept=rest))

    # ------------------------------------------------------------------- modes

    def modes(self) -> Iterator[Mode]:
        """Every choice of a class per pass that differs in what runs."""
        steps = [step for step in self.knowledge.passes if step.name in self._hopeful]
        split = [self._alike(step) for step in steps]
        for choice in product(*split):
            yield self._mode({step.name: alike for step, alike in zip(steps, choice, strict=True)})

    def mode_of(self, combination: Combination) -> Mode:
        """The mode of one combination."""
        classes = {}
        for step in self.knowledge.passes:
            if step.name in self._hopeful:
                name = combination.get(step.name, CUSTOM)
                classes[step.name] = next(alike for alike in self._alike(step) if name in alike.settings)
        return self._mode(classes)

    @property
    def _exact(self) -> RenderOptions:
        """Every pass at its most exact open setting: there, whatever may apply does."""
        if "_exact" not in self.__dict__:
            options = self.options
            for step in self.knowledge.passes:
                chosen = [s for s in self.open.get(step.name, ()) if s.name != step.off]
                if chosen:
                    options = chosen[-1].applied(options)
            self.__dict__["_exact"] = options
        return self.__dict__["_exact"]

    def _exact_at(self, step: Pass, setting: str) -> RenderOptions:
        chosen = [s for s in self.open.get(step.name, ()) if s.name == setting]
        return chosen[0].applied(self._exact) if chosen else self._exact

    @property
    def _hopeful(self) -> frozenset[str]:
        """Passes that apply at some settings."""
        if "_hopeful" not in self.__dict__:
            found = set()
            for step in self.knowledge.passes:
                if step.makes not in self.knowledge.given and step.applies(self._start(step)).runs:
                    found.add(step.name)
            self.__dict__["_hopeful"] = frozenset(found)
        return self.__dict__["_hopeful"]

    def _start(self, step: Pass) -> Outlook:
        """Where the pass applies if it ever does."""
        outlook = self.knowledge.outlook
        kept = outlook.history.kept.get(step.continues.name) if step.continues is not None else None
        return outlook.at(self._exact if kept is None else kept.settings)

    def _alike(self, step: Pass) -> list[Alike]:
        """The pass's open settings by class."""
        memo = self.__dict__.setdefault("_classes", {})
        if step.name not in memo:
            found: dict[tuple[frozenset[AnyBuffer], frozenset[Hashable]], list[str]] = {}
            blended = layers(self.knowledge.passes) if step.blends else ()
            for setting in self.open.get(step.name, (Setting(CUSTOM, {}),)):
                asked = step.asked(self.knowledge.outlook.at(setting.applied(self._exact)))
                inputs = frozenset((*asked, *step.uses, *blended))
                found.setdefault((inputs, self._lost(step, setting)), []).append(setting.name)
            memo[step.name] = [Alike(tuple(names), tuple(i), lost) for (i, lost), names in found.items()]
        return memo[step.name]

    def _lost(self, step: Pass, setting: Setting) -> frozenset[Hashable]:
        """Passes that do not apply, and lasting buffers that do not hold, because of this setting."""
        lost: set[Hashable] = set()
        for other in self.knowledge.passes:
            if other.by_settings and other.name in self._hopeful:
                start = self._start(other)
                if not other.applies(start.at(setting.applied(start.options))).runs:
                    lost.add(other.name)
        for name, kept in self.knowledge.outlook.history.kept.items():
            lasting = kept.buffer.lasting
            if lasting is not None and _shows_in(kept.buffer, step):
                made = lasting.options(setting.applied(kept.settings))
                if not same(made, kept.options):
                    lost.add((name,))
        return frozenset(lost)

    def _mode(self, classes: Mapping[str, Alike]) -> Mode:
        """Who runs: as :func:`torchrender.planning.graph.resolve` has it, from what the classes say."""
        lost = frozenset().union(*(alike.holds for alike in classes.values())) if classes else frozenset()
        applying = [step for step in self.knowledge.passes if step.name in classes and step.name not in lost]
        makers: dict[AnyBuffer, Pass] = {}
        for step in applying:
            if step.makes not in makers:
                for buffer in step.makes_all:
                    makers.setdefault(buffer, step)
        roots: Collection[AnyBuffer] = [s.makes for s in applying if s.for_next and makers[s.makes] is s]
        waiting = [makers[b] for b in (*self.knowledge.wanted, *roots) if b in makers]
        chosen: set[str] = set()
        seen: set[AnyBuffer] = set()
        while waiting:
            step = waiting.pop()
            if step.name in chosen:
                continue
            chosen.add(step.name)
            for buffer in classes[step.name].inputs:
                if buffer in makers:
                    waiting.append(makers[buffer])
                if step.makes.lasting is None:
                    seen.add(buffer)
        running = tuple(step for step in applying if step.name in chosen)
        shown = frozenset(s.name for s in running if s.makes.lasting is None or s.makes in seen)
        kept = self.knowledge.outlook.history.kept
        fresh = frozenset(s.name for s in running if s.makes.name not in kept or (s.makes.name,) in lost)
        return Mode(classes, running, shown, fresh)


@lru_cache(maxsize=1024)
def _shows_in(buffer: AnyBuffer, step: Pass) -> bool:
    """The pass's settings make a difference to what the buffer was made with."""
    assert buffer.lasting is not None
    usual = buffer.lasting.options(RenderOptions())
    settings: Sequence[Setting] = step.settings.all
    return any(not same(buffer.lasting.options(s.applied(RenderOptions())), usual) for s in settings)
