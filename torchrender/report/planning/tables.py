"""Tables of made-up passes: planned and priced, never run."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from torchrender.passes.contract import Pass, always
from torchrender.passes.outlook import Outlook
from torchrender.passes.settings import Setting, Settings
from torchrender.passes.table import PASSES, PICTURE
from torchrender.pipeline.buffer import Buffer, Lasting
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.costs import Knowledge
from torchrender.planning.curves import Curves

SHARED: Buffer[object] = Buffer("shared", object, lasting=Lasting(lambda _: ()))


def made_up(count: int, chance: random.Random, *, asking: int = 0) -> tuple[Pass, ...]:
    """``count`` passes that all the picture needs, with two to five settings each; the first sets the pixels.

    With ``asking``, as many of them ask for a shared thing at the more exact half of their settings; a pass makes it.
    """
    buffers: list[Buffer[object]] = [Buffer(f"b{k}", object) for k in range(count - (3 if asking else 2))]

    def step(name: str, makes: Buffer[Any], rows: Sequence[str], asks: bool) -> Pass:
        exact = rows[len(rows) // 2 :]
        choices = tuple(Setting(row, {f"effects.{name}": row}) for row in rows)
        return Pass(
            name=name, summary=".", makes=makes, applies=always("."), run=lambda _: None,
            settings=Settings("s", choices, choices[-1]), amounts=lambda outlook: (1.0, outlook.pixels),
            asks=lambda outlook: (SHARED,) if asks and outlook.options.effects[name] in exact else (),
        )  # fmt: skip

    first = replace(PASSES[0], checkpoint=None)
    middle = [
        step(f"p{k}", b, [f"s{n}" for n in range(chance.randint(2, 5))], k < asking) for k, b in enumerate(buffers)
    ]
    node = Pass(
        name="shared", summary=".", makes=SHARED, applies=always("."), run=lambda _: None, amounts=lambda _: (1.0, 0.0)
    )
    last = replace(step("end", PICTURE, ["only"], False), needs=(first.makes, *buffers))
    return (first, *middle, *([node] if asking else []), last)


def options_of(passes: Sequence[Pass]) -> RenderOptions:
    """Options at the first setting of every made-up pass."""
    others = [step for step in passes[1:] if step.settings.is_choice or step.name == "end"]
    return RenderOptions(effects={step.name: step.settings.names[0] for step in others}, passes=tuple(passes))


def random_curves(passes: Sequence[Pass], outlook: Outlook, chance: random.Random) -> Curves:
    """Times and errors of every setting by chance."""
    weights, records = {}, {}
    for step in passes:
        length = len(step.amounts(outlook))
        names = step.settings.names
        weights[step.name] = {s: [chance.uniform(0, 40) for _ in range(length)] for s in names}
        records[step.name] = {s: {"flip": chance.choice((0.0, chance.uniform(0, 0.2)))} for s in names}
    known = Curves(weights, {}, chance.choice((1.0, 1.5, 2.0)), {}, "chance")
    return replace(known, scenes={Knowledge(outlook=outlook, curves=known).name: {"passes": records}})
