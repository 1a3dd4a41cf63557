"""A plan in parts of known shares of its cost, each of which can be rendered by another process.

- Hummel, Schonberg and Flynn 1992, "Factoring: A Method for Scheduling Parallel Loops", Communications of the ACM 35(8)

The parts are runs of frames in the plan's order, which is scene by scene: so few scenes are in several of them. Each
frame is in exactly one part, whether it is done or not: parts that start at different times agree.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from lookdev.errors import LookdevError
from lookdev.plan.plan import Plan

MOST_CHUNKS = 100_000


_SMALLEST = 1 / 32
"""Of the first parts' cost, that of the last ones."""


@dataclass(frozen=True)
class Division:
    """A plan in `count` parts: of like cost, or, where `machines` is not 0, for so many that begin them in turn.

    These are rounds of one part for each machine. The parts of a round cost half of those of the one before (Hummel et
    al. 1992, section 3), so that late ones make good what estimates of early ones had wrong. With more than six
    rounds the fall is slower.
    """

    count: int
    machines: int = 0

    @classmethod
    def parse(cls, text: str) -> Division:
        """Read a division as the command line has it, ``8`` or ``48@8``; raises LookdevError."""
        match = re.fullmatch(r"([0-9]{1,6})(?:@([0-9]{1,6}))?", text, re.ASCII)
        count, machines = (int(each) if each is not None else -1 for each in match.groups()) if match else (0, 0)
        if not (1 <= count <= MOST_CHUNKS and (machines == -1 or 1 <= machines <= count)):
            raise LookdevError(
                f"'{text[:40]}' is no number of chunks: 8 are eight of like cost, 48@8 are 48 for eight machines, the "
                f"last ones small; at most {MOST_CHUNKS}, and no fewer than machines"
            )
        return cls(count, 0 if machines in (-1, count) else machines)

    def __str__(self) -> str:
        return f"{self.count}@{self.machines}" if self.machines else str(self.count)

    @property
    def weights(self) -> tuple[float, ...]:
        """The costs of the parts, in that of the first."""
        machines = self.machines or self.count
        fall = max(0.5, _SMALLEST ** (1.0 / max(-(-self.count // machines) - 1, 1)))
        return tuple(fall ** (number // machines) for number in range(self.count))


@dataclass(frozen=True)
class Chunk:
    """Part `number`, from 1, of a division."""

    number: int
    of: Division

    @classmethod
    def parse(cls, text: str) -> Chunk:
        """Read a chunk as the command line has it, ``2/8`` or ``2/48@8``; raises LookdevError."""
        first, _, rest = text.partition("/")
        number = int(first) if re.fullmatch(r"[0-9]{1,6}", first, re.ASCII) else 0
        with suppress(LookdevError):
            of = Division.parse(rest)
            if 1 <= number <= of.count:
                return cls(number, of)
        raise LookdevError(
            f"'{text[:40]}' is no chunk: 2/8 is the second of eight, 1/8 the first, of at most {MOST_CHUNKS}; 2/48@8 "
            "is the second of 48 for eight machines"
        )

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


@dataclass(frozen=True)
class Costs:
    """Seconds: of each frame of a plan, in its order, of a scene before its first frame, and of a process to start."""

    frames: tuple[float, ...]
    scene: float
    start: float


def split(scenes: Sequence[object], costs: Costs, division: Division) -> tuple[int, ...]:
    """Return the end of each part of some frames, in their order, whose most costly one, in its weight, costs least.

    `scenes` are those of the frames, equal ones beside each other. A part that starts within a scene prepares it again,
    which counts. Parts without frames are the last ones.
    """
    weights, count = division.weights, division.count
    changes = [number == 0 or scenes[number] != scenes[number - 1] for number in range(len(scenes))]

    def ends(most: float) -> list[int]:
        """Return the ends of parts that cost at most so much in their weight, but those of a single frame."""
        found: list[int] = []
        cost = 0.0
        for number, seconds in enumerate(costs.frames):
            more = seconds + costs.scene * changes[number]
            if number and cost + more > most * weights[min(len(found), count - 1)]:
                found.append(number)
                cost, more = 0.0, seconds + costs.scene
            cost += more
        return [*found, len(scenes)] if scenes else []

    low = 0.0
    # A part of all costs no more, however the sum is rounded.
    high = 1.000001 * (sum(costs.frames) + costs.scene * sum(changes)) / weights[-1]
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if len(ends(middle)) <= count else (middle, high)
    found = ends(math.nextafter(high, math.inf))
    return (*found, *[len(scenes)] * (count - len(found)))


def part_of(plan: Plan, ends: Sequence[int], number: int) -> Plan:
    """Return part `number`, from 1, of a plan; what is made of several frames is in none."""
    first = ends[number - 2] if number > 1 else 0
    return replace(plan, frames=plan.frames[first : ends[number - 1]], reels=(), sheets=(), skips=())
