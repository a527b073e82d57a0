"""What is to choose for a budget or an error bound: open settings, their times and errors, and how they hang together.

Settings of different passes hang together in few ways, each of which is a *bit* that is set or not: a setting asks for
something that others do not ask for, or lets the picture itself show something that only mirrors would show, or makes
invalid what an earlier picture left. All else adds up: times, and errors to the power of the norm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, TypeVar, cast

from torchrender.passes.contract import Pass, nothing_asked
from torchrender.passes.outlook import Outlook
from torchrender.passes.settings import CUSTOM, Setting
from torchrender.pipeline.buffer import same
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.costs import Knowledge
from torchrender.planning.graph import AnyBuffer, layers

T = TypeVar("T")

USUAL = RenderOptions()

Combination = Mapping[str, str]
"""A setting for every pass with open settings, by its name."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Question:
    """Open settings of the passes of a picture. The first pass sets the number of pixels, which all times follow."""

    knowledge: Knowledge
    options: RenderOptions  # as they stand
    open: Mapping[str, tuple[Setting, ...]]  # by pass
    done: frozenset[str]  # passes that ran: their time is spent
    wary: float = 0.0  # standard deviations that errors count higher by
    share: float = 1.0  # of the time of what lasts: pictures that follow use it, too,
    share_once: float = 1.0  # and of what else is done once, for many pictures
    careful: bool = False  # what no picture of the sequence ran counts longer
    _memo: dict[tuple[object, ...], object] = field(default_factory=dict, repr=False)

    @classmethod
    def about(
        cls,
        knowledge: Knowledge,
        options: RenderOptions,
        done: frozenset[str] = frozenset(),
        *,
        near: bool = False,
        wary: float = 0.0,
        share: float = 1.0,
        careful: bool = False,
        share_once: float = 1.0,
    ) -> Question:
        """All settings are open but those of passes that ran, are held, are off, or stand where no setting is.

        Args:
            near: numbers of pixels far from those of the last picture are not, once two were made: every number makes
                a search longer, and the next search comes soon.
            wary: standard deviations that errors count higher by.
            share: of the time of what lasts that counts.
            share_once: of that of what else is done once.
            careful: what no picture of the sequence ran counts longer, for a budget has to be kept.
        """
        open_ = {}
        for step in knowledge.passes:
            current = step.settings.current(options)
            if current == CUSTOM:
                if step.settle is not None and step.settles(options) and step.name not in options.fixed:
                    open_[step.name] = step.settings.all
                continue
            held = step.name in done or step.name in options.fixed or current == step.off
            open_[step.name] = (step.settings.named(current),) if held else step.settings.all
        first = knowledge.passes[0]
        last = [setting.name for setting in open_.get(first.name, ())]
        if near and knowledge.outlook.history.pictures > 1 and knowledge.pace.choice.get(first.name) in last:
            place = last.index(knowledge.pace.choice[first.name])
            open_[first.name] = open_[first.name][max(place - 1, 0) : place + 2]
        shares: dict[str, Any] = {"share": share, "share_once": share_once}
        return cls(knowledge=knowledge, options=options, open=open_, done=done, wary=wary, careful=careful, **shares)

    @property
    def first(self) -> Pass:
        """The pass that sets the number of pixels."""
        return self.knowledge.passes[0]

    @property
    def counts(self) -> tuple[Setting, ...]:
        """Its settings: numbers of rendered pixels."""
        return self.settings_of(self.first)

    def settings_of(self, step: Pass, count: Setting | None = None) -> tuple[Setting, ...]:
        """Open settings of a pass; of the first one, at a number of pixels, that alone."""
        if step is self.first and count is not None:
            return (count,)
        return self.open.get(step.name, (Setting(CUSTOM, {}),))

    def options_at(self, combination: Combination) -> RenderOptions:
        """The options with these settings."""
        options = self.options
        for step in self.knowledge.passes:
            if step.name in combination:
                options = step.settings.named(combination[step.name]).applied(options)
        return options

    def count_of(self, combination: Combination) -> Setting:
        """The number of pixels of a combination."""
        name = combination.get(self.first.name)
        return next((count for count in self.counts if count.name == name), self.counts[0])

    def once(self, name: str, make: Callable[[], T]) -> T:
        """Something that follows from the question, made when it is first asked for."""
        if (name,) not in self._memo:
            self._memo[name,] = make()
        found: Any = self._memo[name,]
        return cast("T", found)

    # ------------------------------------------------------------ times, errors

    def time_ms(self, step: Pass, setting: Setting, count: Setting, fresh: bool) -> float:
        """Of one pass at one setting and number of pixels; 0 where it ran already or was never measured.

        Args:
            fresh: what an earlier picture left of what it makes does not hold.
        """
        if step.name in self.done:
            return 0.0
        key = ("time", step.name, setting.name, count.name, fresh)
        found = self._memo.get(key)
        if found is None:
            amounts = step.amounts(self._outlook(step, setting, count, fresh))
            found = self.knowledge.predicted_ms(step, setting.name, amounts) or 0.0
            if self.share < 1.0 and step.makes.lasting is not None:
                found *= self.share
            elif min(self.share, self.share_once) < 1.0 and step.did_once(amounts):
                each = self.knowledge.predicted_ms(step, setting.name, step.again(amounts)) or 0.0
                found = each + min(self.share, self.share_once) * (found - each)
            if self.careful:
                found *= self.knowledge.pace.doubt(step.name, setting.name, step.doubt)
            self._memo[key] = found
        assert isinstance(found, float)
        return found

    def error(self, step: Pass, setting: Setting, count: Setting) -> float:
        """Of one pass at one setting, to the power of the norm."""
        if not step.settings.is_choice:
            return 0.0
        key = (
            "error",
            step.name,
            setting.name,
            step.settings.shows(self._exact_at(count)),
            self._fineness(step, count),
        )
        found = self._memo.get(key)
        if found is None:
            told = self.knowledge.setting_error(step, setting.name, self._exact_at(count))
            error = min(told.error * math.exp(self.wary * told.spread), 1.0)
            found = self._memo[key] = float(error**self.knowledge.curves.norm)
        assert isinstance(found, float)
        return found

    def _fineness(self, step: Pass, count: Setting) -> object:
        """What of a number of pixels errors of a pass hang on."""
        hangs = self.knowledge.unseen or step.patterns
        return min(self._exact_at(count).supersample, 1.0) if hangs else None

    def inputs(self, step: Pass, setting: Setting, count: Setting, fresh: bool) -> frozenset[AnyBuffer]:
        """What a pass takes at one setting."""
        plain = step.asks is nothing_asked
        key = ("inputs", step.name) if plain else ("inputs", step.name, setting.name, count.name, fresh)
        found = self._memo.get(key)
        if found is None:
            blended = layers(self.knowledge.passes) if step.blends else ()
            asked = step.needs if plain else step.asked(self._outlook(step, setting, count, fresh))
            found = self._memo[key] = frozenset((*asked, *step.uses, *blended))
        assert isinstance(found, frozenset)
        return found

    def _outlook(self, step: Pass, setting: Setting, count: Setting, fresh: bool) -> Outlook:
        key = ("outlook", step.name, setting.name, count.name, fresh)
        found = self._memo.get(key)
        if found is None:
            found = self._memo[key] = self._make_outlook(step, setting, count, fresh)
        assert isinstance(found, Outlook)
        return found

    def _make_outlook(self, step: Pass, setting: Setting, count: Setting, fresh: bool) -> Outlook:
        outlook, options = self.knowledge.outlook, self._exact_at(count)
        if setting.changes and step is not self.first:
            options = setting.applied(options)
        buffer = lasting_of(step)
        if buffer is None or buffer.lasting is None or buffer.name not in outlook.history.kept:
            return outlook.at(options)
        kept = dict(outlook.history.kept)
        if fresh:
            del kept[buffer.name]
        else:  # as if it was made with these options
            kept[buffer.name] = replace(kept[buffer.name], options=buffer.lasting.options(options))
        return replace(outlook, options=options, history=replace(outlook.history, kept=kept))

    def _exact_at(self, count: Setting) -> RenderOptions:
        key = ("exact", count.name)
        if key not in self._memo:
            self._memo[key] = count.applied(self._exact)
        found = self._memo[key]
        assert isinstance(found, RenderOptions)
        return found

    # -------------------------------------------------------- what may apply

    @cached_property
    def _exact(self) -> RenderOptions:
        """Every pass at its most exact open setting: there, whatever may apply does."""
        options = self.options
        for step in self.knowledge.passes:
            chosen = [s for s in self.open.get(step.name, ()) if s.name != step.off]
            if chosen:
                options = chosen[-1].applied(options)
        return options

    @cached_property
    def hopeful(self) -> tuple[Pass, ...]:
        """Passes that apply at some settings."""
        given = self.knowledge.given
        return tuple(s for s in self.knowledge.passes if s.makes not in given and s.applies(self._start(s)).runs)

    def _start(self, step: Pass) -> Outlook:
        """Where the pass applies if it ever does."""
        outlook = self.knowledge.outlook
        kept = outlook.history.kept.get(step.continues.name) if step.continues is not None else None
        return outlook.at(self._exact if kept is None else kept.settings)

    @cached_property
    def kept(self) -> frozenset[str]:
        """Names of what an earlier picture of the scene left."""
        past = self.knowledge.outlook.history
        scene = past.scene
        return frozenset() if scene is None else frozenset(n for n, one in past.kept.items() if one.holds(scene))

    @cached_property
    def lost(self) -> Mapping[tuple[str, str], frozenset[object]]:
        """By pass and setting: names of passes that do not apply because of it, and (name,) of what does not hold."""
        found: dict[tuple[str, str], set[object]] = {}
        choices = [step for step in self.knowledge.passes if step.settings.is_choice]
        everyone = [(step, setting) for step in choices for setting in self.settings_of(step)]
        for other in self.hopeful:
            if other.by_settings:
                start = self._start(other)
                for step, setting in everyone:
                    if not other.applies(start.at(setting.applied(start.options))).runs:
                        found.setdefault((step.name, setting.name), set()).add(other.name)
        for name in self.kept:
            one = self.knowledge.outlook.history.kept[name]
            for step, setting in everyone:
                if _shows_in(one.buffer, step):
                    assert one.buffer.lasting is not None
                    if not same(one.buffer.lasting.options(setting.applied(one.settings)), one.options):
                        found.setdefault((step.name, setting.name), set()).add((name,))
        return {key: frozenset(names) for key, names in found.items()}


def lasting_of(step: Pass) -> AnyBuffer | None:
    """What decides, by being kept or not, about what a pass costs."""
    return step.rests_on if step.rests_on is not None else step.makes if step.makes.lasting is not None else None


@lru_cache(maxsize=1024)
def _shows_in(buffer: AnyBuffer, step: Pass) -> bool:
    """The pass's settings make a difference to what the buffer was made with."""
    assert buffer.lasting is not None
    usual = buffer.lasting.options(USUAL)
    settings: Sequence[Setting] = step.settings.all
    return any(not same(buffer.lasting.options(s.applied(USUAL)), usual) for s in settings)
