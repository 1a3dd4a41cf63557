"""Division of a plan into chunks (parts) for ``lookdev render --chunk``; one process renders each chunk.

A chunk is a run of consecutive frames of the plan. The plan has its frames scene by scene, so that few scenes are in
several chunks. Each frame is in exactly one chunk, whether it is done or not, so that processes that start at different
times divide the plan in the same way.

- Hummel, Schonberg and Flynn 1992, "Factoring: A Method for Scheduling Parallel Loops", Communications of the ACM 35(8)
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from lookdev.errors import LookdevError
from lookdev.plan.plan import Plan

MAX_CHUNKS = 100_000
"""The maximum number of parts of a division."""

_MIN_COST = 1 / 32
"""The minimum cost of the last parts, relative to the cost of the first part."""


@dataclass(frozen=True)
class Division:
    """A division into `count` parts: of equal cost if `machines` is 0, otherwise in rounds of one part per machine.

    In each round the parts cost half as much as in the round before (Hummel et al. 1992, section 3). The small parts at
    the end compensate for errors in the estimated costs of the large parts. With more than six rounds, the cost falls
    more slowly.
    """

    count: int
    machines: int = 0

    @classmethod
    def parse(cls, text: str) -> Division:
        """Return the division of a text of the command line, such as ``8`` or ``48@8``; raise LookdevError.

        The first number is `count`, the second is `machines`.
        """
        match = re.fullmatch(r"([0-9]{1,6})(?:@([0-9]{1,6}))?", text, re.ASCII)
        count, machines = (int(group) if group is not None else -1 for group in match.groups()) if match else (0, 0)
        if not (1 <= count <= MAX_CHUNKS and (machines == -1 or 1 <= machines <= count)):
            raise LookdevError(
                f"'{text[:40]}' is not a number of chunks: 8 are eight of equal cost, 48@8 are 48 for eight machines, "
                f"the last ones small; at most {MAX_CHUNKS}, and no fewer than machines"
            )
        return cls(count, 0 if machines in (-1, count) else machines)

    def __str__(self) -> str:
        return f"{self.count}@{self.machines}" if self.machines else str(self.count)

    @property
    def weights(self) -> tuple[float, ...]:
        """The cost of each part, relative to the cost of the first part."""
        machines = self.machines or self.count
        fall = max(0.5, _MIN_COST ** (1.0 / max(-(-self.count // machines) - 1, 1)))
        return tuple(fall ** (number // machines) for number in range(self.count))


@dataclass(frozen=True)
class Chunk:
    """Part `number`, counted from 1, of a division."""

    number: int
    division: Division

    @classmethod
    def parse(cls, text: str) -> Chunk:
        """Return the chunk of a text of the command line, such as ``2/8`` or ``2/48@8``; raise LookdevError."""
        first, _, rest = text.partition("/")
        number = int(first) if re.fullmatch(r"[0-9]{1,6}", first, re.ASCII) else 0
        with suppress(LookdevError):
            division = Division.parse(rest)
            if 1 <= number <= division.count:
                return cls(number, division)
        raise LookdevError(
            f"'{text[:40]}' is not a chunk: 2/8 is the second of eight, 1/8 the first, of at most {MAX_CHUNKS}; "
            "2/48@8 is the second of 48 for eight machines"
        )

    def __str__(self) -> str:
        return f"{self.number}/{self.division}"


@dataclass(frozen=True)
class Costs:
    """The costs of a plan in seconds: of each of its frames, of preparing a scene, and of starting a process."""

    frames: tuple[float, ...]
    scene: float
    start: float


def split_frames(scenes: Sequence[object], costs: Costs, division: Division) -> tuple[int, ...]:
    """Return the end of each part of a division: the index of the frame after the part's last frame.

    The division minimizes the maximum, over the parts, of the cost divided by the weight (`Division.weights`). `scenes`
    has the scene of each frame; the frames of a scene are consecutive. A part that begins within a scene has the cost
    of preparing the scene once more. Parts without frames come last.
    """
    weights, count = division.weights, division.count
    # Whether each frame is the first of its scene.
    changes = [number == 0 or scenes[number] != scenes[number - 1] for number in range(len(scenes))]

    def limited_ends(limit: float) -> list[int]:
        """Return the ends of parts that cost at most `limit` times their weight, except parts of one frame."""
        ends: list[int] = []
        cost = 0.0
        for number, seconds in enumerate(costs.frames):
            added = seconds + costs.scene * changes[number]
            if number and cost + added > limit * weights[min(len(ends), count - 1)]:
                ends.append(number)
                cost, added = 0.0, seconds + costs.scene
            cost += added
        return [*ends, len(scenes)] if scenes else []

    low = 0.0
    # Bisection finds the least limit. At the first upper limit, all frames fit into one part, in spite of rounding.
    high = 1.000001 * (sum(costs.frames) + costs.scene * sum(changes)) / weights[-1]
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if len(limited_ends(middle)) <= count else (middle, high)
    ends = limited_ends(math.nextafter(high, math.inf))
    return (*ends, *[len(scenes)] * (count - len(ends)))


def plan_of_part(plan: Plan, ends: Sequence[int], number: int) -> Plan:
    """Return part `number`, counted from 1, of a plan; `ends` is the result of `split_frames`.

    The part has no reels, sheets and skips, because these belong to frames of several parts.
    """
    first = ends[number - 2] if number > 1 else 0
    return replace(plan, frames=plan.frames[first : ends[number - 1]], reels=(), sheets=(), skips=())
