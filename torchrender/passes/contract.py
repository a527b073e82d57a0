"""What a pass is: everything that plans, prices, runs, explains, measures and examines it.

A pass asks for buffers (``needs``: it cannot run without; ``uses``: it takes them where they exist), makes one, says
whether it applies and why, and has settings from fast to exact and a reference. A new effect is one module in
``effects`` and one file beside this one; :mod:`torchrender.passes.table` lists it.

Names of passes and buffers are nouns in the singular; a buffer has the name of the pass that makes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from torchrender.passes.hard import HardEffect
from torchrender.passes.outlook import Outlook, Verdict
from torchrender.passes.settings import ONE_WAY, Settings
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions

Buffers = tuple[Buffer[Any], ...]
Amounts = tuple[float, ...]
Change = Callable[[RenderOptions, RenderHistory], RenderOptions]
Prices = Callable[[RenderOptions], Mapping[Buffer[Any], float | None]]
"""Predicted time of each pass that would run with these options and has not run, by what it makes; None: unknown."""

Settle = Callable[[Outlook, Prices], RenderOptions]
"""The options with what the caller left open; those of the outlook where nothing is."""


def nothing_asked(outlook: Outlook) -> Buffers:
    """No buffers."""
    del outlook
    return ()


def unchanged(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """The options as they are."""
    del history
    return options


@dataclass(frozen=True, kw_only=True)
class OwnMeasure:
    """An effect's own measure beside FLIP: ``error(buffers found, buffers of the reference)``, by name."""

    title: str
    buffer: Buffer[Any]  # that it is about
    error: Callable[[Mapping[str, Any], Mapping[str, Any]], float]


@dataclass(frozen=True, eq=False, kw_only=True)
class Pass:
    """One step of a picture."""

    name: str
    summary: str  # one line for readers
    makes: Buffer[Any]
    also: Buffers = ()  # made beside it: ``run`` then returns a tuple, in this order
    needs: Buffers = ()  # cannot run without
    uses: Buffers = ()  # takes them where somebody makes them
    asks: Callable[[Outlook], Buffers] = nothing_asked  # needed, too, at some settings
    blends: bool = False  # uses every buffer that has a layer
    applies: Callable[[Outlook], Verdict]
    run: Callable[[Frame], Any]

    # what it costs, and what it errs by
    settings: Settings = ONE_WAY
    amounts: Callable[[Outlook], Amounts]  # of work: its time is a weighted sum of these
    one_cost: bool = False  # the weights are the same for all settings: these only change the amounts
    own: OwnMeasure | None = None
    settle: Settle | None = None  # its options may leave the way to the planner,
    settles: Callable[[RenderOptions], bool] = lambda _: False  # and do so here
    coarsens: float = 0.0  # power of the picture's pixels per rendered one and side by which errors of fewer grow
    patterns: tuple[str, ...] = ()  # settings spread over blocks of pixels: theirs do in measured scenes, too
    off: str | None = None  # the setting at which it does not run, if there is one
    measured_with: Mapping[str, Any] = field(default_factory=dict)  # options, where the usual ones are not fit

    # where it stands in the picture
    continues: Buffer[Any] | None = None  # it runs only while this is kept, in place of the buffer's next maker
    rests_on: Buffer[Any] | None = None  # lasts; where it is made anew, so is some of its own work
    once: int = 0  # so many of its last amounts are work done once, for many pictures
    did: Callable[[Frame, Amounts], Amounts] | None = None  # after it ran: what of its amounts it had to do; None: all
    doubt: float = 1.0  # times that a setting may take longer than its amounts say, where no picture told yet
    by_settings: bool = False  # whether it applies depends on settings, its own or those of others
    for_next: bool = False  # what it makes is for the next picture of a sequence: nobody in this one asks for it
    checkpoint: Callable[[Frame], Mapping[str, float]] | None = None  # what is known after it: the plan is made anew
    senses: Callable[[Frame], Mapping[str, float]] | None = None  # by pass: what the errors of its settings follow
    over_samples: Change = unchanged  # options over samples that are not those of the eye
    over_hits: Change = unchanged  # options over what rays hit

    hard: tuple[HardEffect, ...] = ()  # records of the stability suite

    def asked(self, outlook: Outlook) -> Buffers:
        """Buffers that it cannot run without, at the options of the outlook."""
        return (*self.needs, *self.asks(outlook))

    def did_once(self, amounts: Amounts) -> bool:
        """Some of this work is done once."""
        return self.once > 0 and any(amounts[-self.once :])

    def again(self, amounts: Amounts) -> Amounts:
        """The work without what is done once."""
        return (*amounts[: len(amounts) - self.once], *(0.0 for _ in range(self.once)))

    @property
    def makes_all(self) -> Buffers:
        """Everything that it makes."""
        return (self.makes, *self.also)


def always(reason: str) -> Callable[[Outlook], Verdict]:
    """A pass that runs whenever somebody asks for what it makes."""
    verdict = Verdict(True, reason)

    def applies(outlook: Outlook) -> Verdict:
        del outlook
        return verdict

    return applies
