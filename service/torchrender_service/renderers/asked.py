"""Who asks for a job, and how soon it must be done."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from torchrender_service.renderers import jobs

INTERACTIVE_PIXELS = 2**19
"""Of a picture that somebody waits for at a screen; larger ones are batch work."""
INTERACTIVE_MS = 1000.0
"""A budget up to which a picture is interactive whatever its size."""
INTERACTIVE_SIDE = 1024
"""Pixels of the longer side of a photo up to which its fog is a preview."""


SMALL_PIXELS = 2**16
"""Of a picture that gains little from a second thread: where others wait, it leaves that to them."""


class Rank(IntEnum):
    """Classes of work, the most urgent first."""

    GLANCE = 0  # a click: milliseconds, also in the midst of a keyframe
    STREAM = 1
    INTERACTIVE = 2
    BATCH = 3


@dataclass(eq=False, kw_only=True)
class Asked:
    """One job's client, and what became of its turn."""

    client: str = "the service"
    rank: Rank | None = None  # None: by the job
    waited_s: float = 0.0  # set when the job begins
    place: str = ""  # why it is made where it is; set when that is chosen, empty where there is no choice
    threads: int = 0  # of the renderer that the job takes at most; 0: all


def rank_of(job: jobs.Job) -> Rank:
    """The class of a job by what it asks for."""
    if isinstance(job, jobs.FindPixel):
        return Rank.GLANCE
    if isinstance(job, jobs.MakeKeyframe | jobs.MakeLayers | jobs.SmoothKeyframe):
        return Rank.STREAM
    if isinstance(job, jobs.StylePhoto):
        return Rank.BATCH
    if isinstance(job, jobs.FogInPhoto):
        return Rank.BATCH if job.side is None or job.side > INTERACTIVE_SIDE else Rank.INTERACTIVE
    pixels = 0.0
    if isinstance(job, jobs.Render):
        if job.bounds.budget_ms is not None and job.bounds.budget_ms <= INTERACTIVE_MS:
            return Rank.INTERACTIVE
        pixels = _pixels(job)
    elif isinstance(job, jobs.DepthImages):
        pixels = sum(v.width * v.height for v in job.views) * job.around
    elif isinstance(job, jobs.Reproject):
        pixels = job.view.width * job.view.height
    return Rank.BATCH if pixels > INTERACTIVE_PIXELS else Rank.INTERACTIVE


def is_moving(job: jobs.Job) -> bool:
    """A keyframe that somebody moves by: the more even its time, the better."""
    return isinstance(job, jobs.MakeKeyframe) and not job.still


def is_free(job: jobs.Job) -> bool:
    """A picture without a budget: no pace that was learned for it goes astray where it takes longer or less long."""
    return isinstance(job, jobs.Render) and job.bounds.budget_ms is None and job.bounds.max_error is None


def is_small(job: jobs.Job) -> bool:
    """A picture of few pixels that is free."""
    return isinstance(job, jobs.Render) and is_free(job) and _pixels(job) <= SMALL_PIXELS


def _pixels(job: jobs.Render) -> float:
    """All samples counted."""
    return job.view.width * job.view.height * max(1.0, float(job.options.get("supersample", 1.0))) ** 2
