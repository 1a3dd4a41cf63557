"""A plan in parts of like cost, each of which can be rendered by another process.

The parts are runs of frames in the plan's order, which is scene by scene: so few scenes are in several of them. Each
frame is in exactly one part, whether it is done or not: parts that start at different times agree.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from lookdev.errors import LookdevError
from lookdev.plan.plan import Plan

MOST_CHUNKS = 100_000


@dataclass(frozen=True)
class Chunk:
    """Part `number`, from 1, `of` so many."""

    number: int
    of: int

    @classmethod
    def parse(cls, text: str) -> Chunk:
        """Read a chunk as the command line has it, ``2/8``; raises LookdevError."""
        match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text, re.ASCII)
        number, of = (int(each) for each in match.groups()) if match else (0, 0)
        if not 1 <= number <= of <= MOST_CHUNKS:
            raise LookdevError(
                f"'{text[:40]}' is no chunk: 2/8 is the second of eight, 1/8 the first, of at most {MOST_CHUNKS}"
            )
        return cls(number, of)

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


@dataclass(frozen=True)
class Costs:
    """Seconds: of each frame of a plan, in its order, of a scene before its first frame, and of a process to start."""

    frames: tuple[float, ...]
    scene: float
    start: float


def split(scenes: Sequence[object], costs: Costs, count: int) -> tuple[int, ...]:
    """Return the end of each of `count` parts of some frames, in their order, whose most costly part costs least.

    `scenes` are those of the frames, equal ones beside each other. A part that starts within a scene prepares it again,
    which counts. Parts without frames are the last ones.
    """
    if count < 1:
        raise ValueError(f"a plan has at least one part, found: {count}")
    changes = [number == 0 or scenes[number] != scenes[number - 1] for number in range(len(scenes))]

    def ends(most: float) -> list[int]:
        """Return the ends of parts that cost at most so much, but those of a single frame."""
        found: list[int] = []
        cost = 0.0
        for number, seconds in enumerate(costs.frames):
            more = seconds + costs.scene * changes[number]
            if number and cost + more > most:
                found.append(number)
                cost, more = 0.0, seconds + costs.scene
            cost += more
        return [*found, len(scenes)] if scenes else []

    low = 0.0
    high = sum(costs.frames) + costs.scene * sum(changes)
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if len(ends(middle)) <= count else (middle, high)
    found = ends(math.nextafter(high, math.inf))
    return (*found, *[len(scenes)] * (count - len(found)))


def part_of(plan: Plan, ends: Sequence[int], number: int) -> Plan:
    """Return part `number`, from 1, of a plan; what is made of several frames is in none."""
    first = ends[number - 2] if number > 1 else 0
    return replace(plan, frames=plan.frames[first : ends[number - 1]], reels=(), sheets=(), skips=())
