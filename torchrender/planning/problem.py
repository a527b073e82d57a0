"""A question at one number of pixels as stages to fold: rows of costs, and the bits by which they hang together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from torchrender.passes.contract import Pass
from torchrender.passes.settings import Setting
from torchrender.planning.graph import AnyBuffer
from torchrender.planning.question import Combination, Question, lasting_of

Cost = tuple[float, float]
"""Milliseconds, and error to the power of the norm."""

RUN, SEEN, FRESH, LOST = "run", "seen", "fresh", "lost"
"""Kinds of bits: a pass runs; its error shows; what was kept of it does not hold; it does not apply."""

VALID = 1
"""Bit of all settings so far letting the pass run that goes on from an earlier picture."""


@dataclass(frozen=True)
class Row:
    """A setting of a pass."""

    name: str
    kept_ms: float  # going on from what was kept
    fresh_ms: float
    error: float  # to the power of the norm
    sets: int  # bits
    breaks: bool  # the pass that goes on from an earlier picture does not run with it


@dataclass(frozen=True)
class Stage:
    """A pass with several settings. Without its ``run`` bit it costs nothing, without ``seen`` its error is none."""

    name: str
    rows: tuple[Row, ...]
    run: int = 0  # bits; 0: it runs, or shows, in any case
    seen: int = 0
    fresh: int = 0

    @property
    def asks(self) -> int:
        """Bits that must be settled before it."""
        return self.run | self.seen | self.fresh

    @property
    def sets(self) -> int:
        """Bits that it may set."""
        bits = 0
        for row in self.rows:
            bits |= row.sets | (VALID if row.breaks else 0)
        return bits

    def cost(self, row: Row, bits: int) -> tuple[float, float]:
        """Time and error with these bits."""
        if self.run and not bits & self.run:
            return 0.0, 0.0
        shows = not self.seen or bool(bits & self.seen)
        return row.fresh_ms if bits & self.fresh else row.kept_ms, row.error if shows else 0.0

    def least(self, row: Row) -> tuple[float, float]:
        """What the row costs at least."""
        time = 0.0 if self.run else min(row.kept_ms, row.fresh_ms) if self.fresh else row.kept_ms
        return time, 0.0 if self.run or self.seen else row.error


@dataclass(eq=False)
class Problem:
    """Stages in an order in which bits are set before they are asked, and what each bit costs once."""

    count: Setting
    base: tuple[float, float]  # time and error of what runs in any case and knows one way
    stages: list[Stage]
    prices: dict[int, Cost]  # by bit
    settled: dict[str, str]  # settings of passes that have one only here
    start: int  # bits that are set from the beginning
    must_break: bool  # combinations that leave VALID set belong to another problem
    live: list[int] = field(init=False)  # bits that matter after each stage

    def __post_init__(self) -> None:
        priced = 0
        for bit in self.prices:
            priced |= bit
        wanted, self.live = VALID if self.must_break else 0, []
        for stage in reversed(self.stages):
            self.live.append(wanted)
            wanted |= stage.asks | (stage.sets & priced)
        self.live.reverse()

    @property
    def least_time(self) -> float:
        """Of the base, if everything that may be saved is."""
        return self.base[0] + sum(min(time, 0.0) for time, _ in self.prices.values())

    def pay(self, before: int, after: int) -> Cost:
        """What the bits cost that were set in between."""
        time, error, new = 0.0, 0.0, after & ~before
        while new:
            bit = new & -new
            price = self.prices.get(bit)
            if price is not None:
                time, error = time + price[0], error + price[1]
            new ^= bit
        return time, error

    def step(self, stage: Stage, row: Row, bits: int) -> tuple[float, float, int]:
        """Time and error of a row, and the bits after it."""
        after = bits | row.sets
        if row.breaks:
            after &= ~VALID
        time, error = stage.cost(row, after)
        if after & ~bits:
            paid = self.pay(bits, after)
            time, error = time + paid[0], error + paid[1]
        return time, error, after

    def cost(self, combination: Combination) -> tuple[float, float] | None:
        """Of one combination; None if it belongs to another problem."""
        if any(combination.get(name, setting) != setting for name, setting in self.settled.items()):
            return None
        bits, time, error = self.start, *self.base
        for stage in self.stages:
            name = combination.get(stage.name, stage.rows[0].name)
            row = next((row for row in stage.rows if row.name == name), None)
            if row is None:
                return None
            own = self.step(stage, row, bits)
            time, error, bits = time + own[0], error + own[1], own[2]
        return None if self.must_break and bits & VALID else (time, error)


def problems(question: Question, count: Setting) -> list[Problem]:
    """That of a number of pixels, and another one where a pass may go on from an earlier picture."""
    going_on = next((step for step in question.hopeful if step.continues is not None), None)
    if going_on is None or not _may_go_on(question, count, going_on):
        return [_Builder(question, count, None, False).problem()]
    return [_Builder(question, count, going_on, runs).problem() for runs in (True, False)]


def _may_go_on(question: Question, count: Setting, going_on: Pass) -> bool:
    """Every pass has a setting that leaves valid what the earlier picture left; one may be held where none does."""

    def leaves(step: Pass, setting: Setting) -> bool:
        return going_on.name not in question.lost.get((step.name, setting.name), frozenset())

    passes = question.knowledge.passes
    return leaves(question.first, count) and all(
        any(leaves(step, setting) for setting in question.settings_of(step, count)) for step in passes
    )


class _Builder:
    """Makes the problem of one number of pixels.

    Args:
        going_on: the pass that may go on from an earlier picture; ``runs`` says whether it does.
    """

    def __init__(self, question: Question, count: Setting, going_on: Pass | None, runs: bool) -> None:
        self._question, self._count, self._going_on, self._runs = question, count, going_on, runs
        self._bits: dict[tuple[str, str], int] = {}
        self._prices: dict[int, Cost] = {}
        self._next = VALID << 1
        self._asked_by: dict[tuple[bool, frozenset[AnyBuffer]], int] = {}
        self._makers: dict[AnyBuffer, Pass] = {}
        for step in question.hopeful:
            if step.makes not in self._makers and (step.continues is None or (runs and step is going_on)):
                for buffer in step.makes_all:
                    self._makers.setdefault(buffer, step)
        self._settings = {step.name: self._open(step) for step in question.knowledge.passes}
        self._sure = self._surely_running()

    def problem(self) -> Problem:
        """The stages of all passes that may run, and of those whose settings decide about others."""
        steps = list(dict.fromkeys(self._makers.values()))
        stages = []
        for step in self._question.knowledge.passes:
            if len(self._settings[step.name]) > 1:
                if step in steps:
                    rows = tuple(self._row(step, setting) for setting in self._settings[step.name])
                    bits = (self._bit(kind, step) for kind in (RUN, SEEN, FRESH))
                    stages.append(Stage(step.name, rows, *bits))
                elif any(self._lost(step, setting) for setting in self._settings[step.name]):
                    rows = tuple(self._decision(step, setting) for setting in self._settings[step.name])
                    stages.append(Stage(step.name, rows))
        time, error, start = 0.0, 0.0, VALID
        for step in self._sure.values():
            if len(self._settings[step.name]) == 1:
                row = self._row(step, self._settings[step.name][0])
                time, start = time + row.kept_ms, start | row.sets
                error += row.error if step.makes.lasting is None else 0.0
        question = self._question
        for step in question.knowledge.passes:
            if step.off is not None and step not in steps and question.knowledge.leaves_out(step, question.options):
                error += question.error(step, step.settings.named(step.off), self._count)
        # What is set from the beginning is paid from the beginning.
        paid = [price for bit, price in self._prices.items() if bit & start]
        time, error = time + sum(p[0] for p in paid), error + sum(p[1] for p in paid)
        must_break = self._going_on is not None and not self._runs
        settled = {name: open_[0].name for name, open_ in self._settings.items() if len(open_) == 1}
        return Problem(self._count, (time, error), _ordered(stages), self._prices, settled, start, must_break)

    # ---------------------------------------------------------------- what runs

    def _open(self, step: Pass) -> tuple[Setting, ...]:
        """Open settings; where a pass goes on, only those that let it."""
        found = self._question.settings_of(step, self._count)
        if not self._runs or self._going_on is None:
            return found
        return tuple(s for s in found if self._going_on.name not in self._lost(step, s))

    def _lost(self, step: Pass, setting: Setting) -> Iterable[object]:
        return self._question.lost.get((step.name, setting.name), frozenset())

    def _surely_running(self) -> dict[str, Pass]:
        """Passes that run whatever is chosen; those that a setting may keep from it count, and are taken off again."""
        makers, sure = self._makers, {}
        for_next = [step for buffer, step in makers.items() if step.for_next and step.makes is buffer]
        waiting = [*(makers[b] for b in self._question.knowledge.asked if b in makers), *for_next]
        while waiting:
            step = waiting.pop()
            if step.name not in sure:
                sure[step.name] = step
                common = frozenset.intersection(*self._inputs_of(step))
                waiting += [makers[buffer] for buffer in common if buffer in makers]
        return sure

    def _inputs_of(self, step: Pass) -> list[frozenset[AnyBuffer]]:
        """By setting, with and without what was kept."""
        states = (True, False) if step.makes.name in self._question.kept else (True,)
        return [
            self._question.inputs(step, setting, self._count, fresh)
            for setting in self._settings[step.name]
            for fresh in states
        ]

    # --------------------------------------------------------------------- bits

    def _bit(self, kind: str, step: Pass) -> int:
        """The bit of that kind of a pass; 0 where it is no question. Its price is what it costs to set it."""
        if kind == RUN and step.name in self._sure:
            return 0
        if kind == SEEN and (step.makes.lasting is None or not step.settings.is_choice):
            return 0
        if kind == FRESH:
            buffer = lasting_of(step)
            if buffer is None or buffer.name not in self._question.kept:
                return 0
            step = self._makers.get(buffer, step)
        key = (kind, step.name)
        if key not in self._bits:
            self._bits[key] = bit = self._next
            self._next <<= 1
            if len(self._settings[step.name]) == 1:
                self._prices[bit] = self._price(kind, step)
        return self._bits[key]

    def _price(self, kind: str, step: Pass) -> Cost:
        setting, question = self._settings[step.name][0], self._question
        kept = step.makes.name in question.kept
        own = question.time_ms(step, setting, self._count, not kept)
        error = question.error(step, setting, self._count)
        if kind == SEEN:
            return 0.0, error
        if kind == FRESH:
            return question.time_ms(step, setting, self._count, True) - own, 0.0
        shown = 0.0 if step.makes.lasting is not None else error
        return (own, shown) if kind == RUN else (-own, -shown)

    def _asked(self, step: Pass, inputs: frozenset[AnyBuffer]) -> int:
        """Bits that a pass sets by asking for these, what these ask for included."""
        key = (step.makes.lasting is None, inputs)
        if key not in self._asked_by:
            self._asked_by[key] = self._find_asked(step, inputs)
        return self._asked_by[key]

    def _find_asked(self, step: Pass, inputs: frozenset[AnyBuffer]) -> int:
        bits = 0
        for buffer in inputs:
            maker = self._makers.get(buffer)
            if maker is None:
                continue
            own = self._bit(RUN, maker)
            bits |= own
            if own and len(self._settings[maker.name]) == 1:
                fresh = maker.makes.name not in self._question.kept
                setting = self._settings[maker.name][0]
                bits |= self._asked(maker, self._question.inputs(maker, setting, self._count, fresh))
            if step.makes.lasting is None:
                bits |= self._bit(SEEN, maker)
        return bits

    def _row(self, step: Pass, setting: Setting) -> Row:
        question, buffer = self._question, lasting_of(step)
        kept = buffer is not None and buffer.name in question.kept
        fresh_ms = question.time_ms(step, setting, self._count, True)
        kept_ms = question.time_ms(step, setting, self._count, False) if kept else fresh_ms
        bits = self._asked(step, question.inputs(step, setting, self._count, not kept))
        made = self._decision(step, setting)
        error = question.error(step, setting, self._count)
        return Row(setting.name, kept_ms, fresh_ms, error, bits | made.sets, made.breaks)

    def _decision(self, step: Pass, setting: Setting) -> Row:
        """What a setting decides about other passes, whether its own runs or not."""
        bits, lost = 0, self._lost(step, setting)
        for other in dict.fromkeys(self._makers.values()) if lost else ():
            if other.name in lost and other.name in self._sure:
                bits |= self._bit(LOST, other)
            if (other.makes.name,) in lost:
                bits |= self._bit(FRESH, other)
                if len(self._settings[other.name]) == 1:
                    setting_ = self._settings[other.name][0]
                    bits |= self._asked(other, self._question.inputs(other, setting_, self._count, True))
        breaks = self._going_on is not None and not self._runs and self._going_on.name in lost
        return Row(setting.name, 0.0, 0.0, 0.0, bits, breaks)


def _ordered(stages: list[Stage]) -> list[Stage]:
    """Each after those that set the bits which it asks."""
    left, ordered = list(stages), []
    while left:
        free = [s for s in left if not any(s.asks & other.sets for other in left if other is not s)]
        # Should passes decide about each other in a circle, the order of the table is as good as any.
        ordered.append((free or left)[0])
        left.remove(ordered[-1])
    return ordered
