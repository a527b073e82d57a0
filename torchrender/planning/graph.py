"""Which passes make the wanted buffers, in what order, and why the others do not run."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from torchrender.errors import OptionError
from torchrender.passes.contract import Pass
from torchrender.passes.outlook import Outlook, Verdict
from torchrender.pipeline.buffer import Buffer

AnyBuffer = Buffer[Any]


@dataclass(frozen=True, eq=False)
class Graph:
    """The passes that run, in order, and who asks for what."""

    running: tuple[Pass, ...]
    verdicts: Mapping[str, Verdict]  # of all passes, by name
    asked: Mapping[AnyBuffer, frozenset[AnyBuffer]]  # by the passes that make these


def layers(passes: Sequence[Pass]) -> tuple[AnyBuffer, ...]:
    """What is blended into the picture."""
    return tuple(dict.fromkeys(step.makes for step in passes if step.makes.layer is not None))


def inputs(step: Pass, outlook: Outlook, blended: Collection[AnyBuffer]) -> tuple[AnyBuffer, ...]:
    """Everything that a pass takes where somebody makes it."""
    return (*step.asked(outlook), *step.uses, *(blended if step.blends else ()))


def resolve(
    passes: Sequence[Pass], outlook: Outlook, wanted: Collection[AnyBuffer], given: Collection[AnyBuffer] = ()
) -> Graph:
    """The graph of a picture: a pass runs if it applies, makes what nobody made before, and somebody wants it.

    Args:
        given: buffers that are there already.

    Raises:
        OptionError: passes wait for each other.
    """
    found = _applying(passes, outlook, given)
    makers = _makers(passes, found)
    blended = layers(passes)
    asked: dict[AnyBuffer, set[AnyBuffer]] = {}
    chosen: dict[str, Pass] = {}
    kept_for_next = [step.makes for step in passes if step.for_next and makers.get(step.makes) is step]
    waiting = [makers[buffer] for buffer in (*wanted, *kept_for_next) if buffer in makers]
    while waiting:
        step = waiting.pop()
        if step.name in chosen:
            continue
        chosen[step.name] = step
        for buffer in inputs(step, outlook, blended):
            if buffer in makers:
                waiting.append(makers[buffer])
            if buffer in makers or buffer in given:
                asked.setdefault(buffer, set()).add(step.makes)
    for step in passes:
        if found[step.name].runs and step.name not in chosen:
            found[step.name] = Verdict(False, "nobody asks for what it makes")
    running = _in_order([step for step in passes if step.name in chosen], outlook, blended)
    for step in running:
        if step.makes.lasting is not None and not step.for_next:
            askers = {buffer for made in step.makes_all for buffer in asked.get(made, ())}
            users = ", ".join(s.name for s in running if s.makes in askers)
            found[step.name] = Verdict(True, f"{found[step.name].reason}: for {users}" if users else "asked for")
    return Graph(tuple(running), found, {buffer: frozenset(by) for buffer, by in asked.items()})


def _applying(passes: Sequence[Pass], outlook: Outlook, given: Collection[AnyBuffer]) -> dict[str, Verdict]:
    """Verdicts from what each pass knows by itself, and from what others can make for it."""
    found = {step.name: Verdict(False, "given") if step.makes in given else step.applies(outlook) for step in passes}
    while True:
        made = {buffer for step in passes if found[step.name].runs for buffer in step.makes_all} | set(given)
        lost = False
        for step in passes:
            if found[step.name].runs:
                missing = [buffer.name for buffer in step.asked(outlook) if buffer not in made]
                if missing:
                    found[step.name], lost = Verdict(False, f"nobody makes {', '.join(missing)}"), True
        if not lost:
            return found


def _makers(passes: Sequence[Pass], found: dict[str, Verdict]) -> dict[AnyBuffer, Pass]:
    """Who makes a buffer: the first that applies; the others are told so."""
    makers: dict[AnyBuffer, Pass] = {}
    for step in passes:
        if not found[step.name].runs:
            continue
        maker = makers.get(step.makes)
        if maker is not None:
            found[step.name] = Verdict(False, f"done by {maker.name}")
            continue
        for buffer in step.makes_all:
            makers.setdefault(buffer, step)
    return makers


def _in_order(passes: Sequence[Pass], outlook: Outlook, blended: Collection[AnyBuffer]) -> list[Pass]:
    """Each after those whose buffers it asks for."""
    left = {step.name: step for step in passes}
    waits = {step.name: set(inputs(step, outlook, blended)) for step in passes}
    ordered: list[Pass] = []
    while left:
        open_ = {buffer for step in left.values() for buffer in step.makes_all}
        ready = next((step for step in left.values() if not waits[step.name] & (open_ - set(step.makes_all))), None)
        if ready is None:
            raise OptionError(f"passes wait for each other: {', '.join(left)}")
        ordered.append(ready)
        del left[ready.name]
    return ordered
