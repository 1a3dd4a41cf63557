"""IES profiles: the luminous intensity of a luminaire in each direction, from files of ANSI/IES LM-63.

The `Shaping` of a light multiplies the light's radiance by a profile. The supported files have type C goniophotometry,
LM-63-1991 to LM-63-2019. The fields for tilt, lamp and luminous opening are read and have no effect, as in the
reference implementation of UsdLux.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.table import NumberTable, look_up
from lookdev.brdf.vectors import Array, Real
from lookdev.cache import Content
from lookdev.errors import EnvironmentMapError
from lookdev.safe_text import read_bytes

_MAX_BYTES = 1 << 24  # bytes of a file
_MAX_ANGLES = 3601
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_HEADERS = ("IESNA91", "IESNA:LM-63-", "IES:LM-63-")
# The ranges of angles in degrees, first to last, that a file may have.
_VERTICAL = ((0.0, 90.0), (90.0, 180.0), (0.0, 180.0))
_HORIZONTAL = ((0.0, 0.0), (0.0, 90.0), (0.0, 180.0), (0.0, 360.0), (90.0, 270.0))


@dataclass(frozen=True)
class IesProfile:
    """An IES profile of `UsdLuxShapingAPI`, as a table.

    Parameters
    ----------
    table
        A ``.npy`` file of float32, (1 + H, 1 + V), for H horizontal and V vertical angles in degrees. The first row has
        the vertical angles, from the light's axis. The first column has the horizontal angles from 0 to 360, from the
        light's x towards its y. The rest is the luminous intensity in candela; it is interpolated bilinearly between
        the angles, and is 0 beyond the first and the last vertical angle.
    scale
        The factor of the intensity.
    angle_scale
        The value of ``inputs:shaping:ies:angleScale``, which stretches the vertical angles.
    """

    table: Content
    scale: float = 1.0
    angle_scale: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.angle_scale) and math.isfinite(self.scale) and self.scale >= 0.0):
            raise EnvironmentMapError(
                f"an IES profile's scale {self.scale:g} and angle scale {self.angle_scale:g}: finite numbers, the "
                "first not negative, would be right"
            )

    @cached_property
    def values(self) -> Floats:
        """The content of `table`, (1 + H, 1 + V)."""
        return np.asarray(np.load(self.table.path), np.float64)

    @property
    def largest(self) -> float:
        """The largest value of `factor`."""
        return self.scale * float(self.values[1:, 1:].max())

    @cached_property
    def numbers(self) -> Floats:
        """The numbers (n,) that `profile_factor` reads: the counts of rows and columns, then the table."""
        return np.concatenate([np.array(self.values.shape, np.float64), self.values.ravel()])

    @property
    def steps(self) -> int:
        """The number of bisections with which `profile_factor` finds an angle in the table."""
        return max(self.values.shape).bit_length()

    def factor(self, vertical: Floats, horizontal: Floats) -> Floats:
        """Return the factor (...) of the radiance at vertical and horizontal angles (...) in degrees, see `table`."""
        table = NumberTable(self.numbers[:, None])
        factor = profile_factor(table, 0.0, self.steps, vertical, horizontal, self.scale, self.angle_scale)
        return np.asarray(factor, np.float64)


def profile_factor(
    table: NumberTable, start: Real, steps: int, vertical: Floats, horizontal: Floats, scale: Real, angle_scale: Real
) -> Floats:
    """Return `IesProfile.factor`; the arrays may be symbolic.

    `table` is a column of numbers that has `IesProfile.numbers` from row `start` on, and `steps` is `IesProfile.steps`.
    """

    def number(index: Array) -> Array:
        """Return the number of `IesProfile.numbers` at an index."""
        return look_up(table, start + index, 0.0)

    # UsdLuxShapingAPI, inputs:shaping:ies:angleScale.
    divisor = np.where(angle_scale == 0.0, 1.0, angle_scale)
    measured_from_back = (vertical - 180.0) / -divisor + 180.0
    vertical = np.where(angle_scale < 0.0, measured_from_back, vertical / divisor)
    rows, columns = number(np.zeros_like(vertical)), number(np.ones_like(vertical))

    def interval(count: Real, angle_at: Callable[[Array], Array], angle: Array) -> Array:
        """Return the index of the last of the table's angles, apart from the final one, that is at most `angle`.

        `angle_at` returns the angle at an index. An index is a position in the table's first row or column, which
        has `count` numbers; the first angle has index 1.
        """
        index = np.ones_like(angle)
        for step in reversed(range(steps)):
            candidate = np.minimum(index + 2.0**step, count - 2.0)
            index = np.where(angle_at(candidate) <= angle, np.maximum(candidate, index), index)
        return index

    def vertical_at(v: Array) -> Array:
        return number(2.0 + v)

    def horizontal_at(h: Array) -> Array:
        return number(2.0 + h * columns)

    # The angles are between columns v and v + 1, at the fraction s, and between rows h and h + 1, at the fraction t.
    v, h = interval(columns, vertical_at, vertical), interval(rows, horizontal_at, horizontal)
    s = (vertical - vertical_at(v)) / (vertical_at(v + 1) - vertical_at(v))
    t = (horizontal - horizontal_at(h)) / (horizontal_at(h + 1) - horizontal_at(h))

    def row_value(h: Array) -> Array:
        return (1.0 - s) * number(2.0 + h * columns + v) + s * number(2.0 + h * columns + (v + 1))

    covered = (vertical_at(np.ones_like(v)) <= vertical) & (vertical <= vertical_at(columns - 1.0))
    return np.where(covered, scale * ((1.0 - t) * row_value(h) + t * row_value(h + 1)), 0.0)


def load_profile(file: Path, *, angle_scale: float = 0.0, normalize: bool = False) -> IesProfile:
    """Read a profile from an IES file; with `normalize` its scale is 1 over its `profile_power`.

    Raises
    ------
    TextError
        The file cannot be read.
    EnvironmentMapError
        The file is not an IES file of type C, or contradicts itself; the message names the line.
    """
    table = parse_profile(read_bytes(file, _MAX_BYTES).decode("latin-1"), str(file))
    power = profile_power(table) if normalize else 1.0
    if not power > 0.0:
        raise EnvironmentMapError(f"{file}: sends no light, so its power cannot be normalized")
    content = Content.store_written(".npy", lambda path: np.save(path, table.astype(np.float32)))
    return IesProfile(content, 1.0 / power, angle_scale)


def profile_power(table: Floats) -> float:
    """Return the mean intensity of a table over the sphere, or over the hemisphere if its angles cover only that.

    UsdLuxShapingAPI, ``inputs:shaping:ies:normalize``, does not define the power by which it divides. The reference
    implementation of UsdLux (hdEmbree) divides by this mean, which it integrates by the midpoints of patches. Here the
    integral of the bilinear table is exact.
    """
    vertical, horizontal, candela = np.radians(table[0, 1:]), np.radians(table[1:, 0]), table[1:, 1:]
    # The integral of a linear function times the sine over a vertical step is a weighted sum of the function's
    # values at both ends. `weights` (V,) has the sum of these weights for each angle.
    step = np.diff(vertical)
    mean = (np.sin(vertical[1:]) - np.sin(vertical[:-1])) / step
    weights = np.zeros(len(vertical))
    weights[:-1] += np.cos(vertical[:-1]) - mean
    weights[1:] += mean - np.cos(vertical[1:])
    rings = candela @ weights
    total = float((np.diff(horizontal) * (rings[1:] + rings[:-1]) / 2.0).sum())
    # Vertical angles cover pi / 2 for a hemisphere, or pi for the sphere; 1.6 is between the two.
    return total / (2.0 * np.pi * (1.0 if vertical[-1] - vertical[0] < 1.6 else 2.0))


def parse_profile(text: str, where: str) -> Floats:
    """Return the table of an IES file, (1 + H, 1 + V), as `IesProfile.table`; `where` names the file in messages."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if not lines[0].startswith(_HEADERS):
        raise _fault(where, 1, f"an IES file begins with {', '.join(_HEADERS)}")
    tilts = [number for number, line in enumerate(lines, 1) if line.startswith("TILT=")]
    if not tilts:
        raise _fault(where, len(lines), "no line 'TILT=', after which an IES file has its numbers")
    numbers = _NumberReader(where, lines, tilts[0])
    if lines[tilts[0] - 1].strip() == "TILT=INCLUDE":
        numbers.take_integer("lamp to luminaire geometry", 1, 3)
        count = numbers.take_integer("number of tilt angles", 1, _MAX_ANGLES)
        numbers.take("tilt angles", count)
        numbers.take("tilt factors", count)
    numbers.take_integer("number of lamps", 1, 1 << 16)
    numbers.take("lumens of a lamp", 1)  # -1: absolute photometry
    multiplier = numbers.take_positive("candela multiplier")
    vertical_count = numbers.take_integer("number of vertical angles", 2, _MAX_ANGLES)
    horizontal_count = numbers.take_integer("number of horizontal angles", 1, _MAX_ANGLES)
    kind = numbers.take_integer("photometric type", 1, 3)
    if kind != 1:
        raise numbers.fault(f"is of type {'?CBA'[kind]} goniophotometry; type C, 1, would be right")
    numbers.take_integer("unit of the luminous opening", 1, 2)
    numbers.take("width, length and height", 3)
    factor = multiplier * numbers.take_positive("ballast factor") * numbers.take_positive("ballast-lamp factor")
    numbers.take("input watts", 1)
    vertical = numbers.take_angles("vertical angles", vertical_count, _VERTICAL)
    horizontal = numbers.take_angles("horizontal angles", horizontal_count, _HORIZONTAL)
    rows = []
    for _ in range(horizontal_count):
        row = numbers.take("candela values", vertical_count)
        if not (row >= 0.0).all():
            raise numbers.fault(f"candela value {row.min():g}: none is negative")
        rows.append(row)
    numbers.check_end()
    horizontal, candela = _mirror_to_full_circle(horizontal, np.stack(rows))
    table = np.zeros((1 + len(horizontal), 1 + len(vertical)))
    table[0, 1:], table[1:, 0], table[1:, 1:] = vertical, horizontal, factor * candela
    if not table.max() < 1e18:
        raise _fault(where, len(lines), f"a candela value of {table.max():g}; at most 1e18 would be right")
    return table


def _mirror_to_full_circle(horizontal: Floats, candela: Floats) -> tuple[Floats, Floats]:
    """Mirror horizontal angles and values (H, V) of a symmetric luminaire, and return those from 0 to 360 degrees."""
    if horizontal[0] == 90.0:  # symmetric about the plane of 90 and 270 degrees: the mirror image of a is 540 - a
        angles = np.unique(np.concatenate([horizontal, (540.0 - horizontal) % 360.0, [0.0, 360.0]]))
        source = np.where((angles < 90.0) | (angles > 270.0), (540.0 - angles) % 360.0, angles)
        return angles, np.stack([np.interp(source, horizontal, column) for column in candela.T], axis=-1)
    if len(horizontal) == 1:
        return np.array([0.0, 360.0]), candela[[0, 0]]
    # Angles from 0 to 90 are mirrored to 180, and angles from 0 to 180 to 360.
    for half in (90.0, 180.0):
        if horizontal[-1] == half:
            horizontal = np.concatenate([horizontal, 2.0 * half - horizontal[-2::-1]])
            candela = np.concatenate([candela, candela[-2::-1]])
    return horizontal, candela


def _fault(where: str, line: int, problem: str) -> EnvironmentMapError:
    return EnvironmentMapError(f"{where}, line {line}: {problem}")


class _NumberReader:
    """Reads the numbers of an IES file one after the other, beginning after line `after`.

    Every `take` method raises EnvironmentMapError, with the line, if the next numbers are missing or wrong.
    """

    def __init__(self, where: str, lines: list[str], after: int) -> None:
        self._where = where
        self._lines = len(lines)
        numbered = enumerate(lines[after:], after + 1)
        self._tokens = [(token, number) for number, line in numbered for token in re.findall(r"[^\s,]+", line)]
        self._next = 0

    def fault(self, problem: str) -> EnvironmentMapError:
        """Return an error at the line of the number that was taken last."""
        return _fault(self._where, self._tokens[self._next - 1][1] if self._next else self._lines, problem)

    def take(self, name: str, count: int) -> Floats:
        tokens = self._tokens[self._next : self._next + count]
        if missing := count - len(tokens):
            raise _fault(self._where, self._lines, f"the file ends before its {name}: {missing} are missing")
        values = np.empty(count)
        for index, (token, _) in enumerate(tokens):
            self._next += 1
            values[index] = float(token) if _NUMBER.fullmatch(token) else math.nan
            if not math.isfinite(values[index]):
                raise self.fault(f"{token[:40]!r} among the {name} is not a number")
        return values

    def take_integer(self, name: str, least: int, most: int) -> int:
        value = float(self.take(name, 1)[0])
        if not (value.is_integer() and least <= value <= most):
            raise self.fault(f"{name} {value:g}: a whole number from {least} to {most} would be right")
        return int(value)

    def take_positive(self, name: str) -> float:
        value = float(self.take(name, 1)[0])
        if not value > 0.0:
            raise self.fault(f"{name} {value:g}: a number above 0 would be right")
        return value

    def take_angles(self, name: str, count: int, ranges: tuple[tuple[float, float], ...]) -> Floats:
        values = self.take(name, count)
        if (np.diff(values) <= 0.0).any():
            raise self.fault(f"the {name} do not increase")
        if (values[0], values[-1]) not in ranges:
            right = ", ".join(f"{first:g} to {last:g}" for first, last in ranges)
            raise self.fault(f"the {name} are from {values[0]:g} to {values[-1]:g}; {right} would be right")
        return values

    def check_end(self) -> None:
        if self._next < len(self._tokens):
            more = len(self._tokens) - self._next
            self._next += 1
            raise self.fault(f"the file has {more} numbers more than it announces")
