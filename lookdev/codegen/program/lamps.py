"""The functions of `lookdev.light`, traced, as operations whose symbols are the fields of a light's row."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import cache
from typing import cast

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.table import Table
from lookdev.codegen.program.written import ProgramWriter
from lookdev.codegen.source import Operation
from lookdev.codegen.trace.graph import Graph, Scalar
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.light.dome.local import meet_ball, share_within, towards_ball
from lookdev.light.emission import DEGREES, azimuth, cone_factor, falloff_factor, focus_factor, off_axis, shadow_passed
from lookdev.light.ies import profile_factor
from lookdev.light.lamps import SHAPES, weight
from lookdev.light.picture import CELL_SEGMENTS
from lookdev.light.rect import Picture
from lookdev.light.spherical_rectangle import Point, density, draw, meet_plane, seen_part, towards_plane

SHADOW_FIELDS = ("shadow", "limit", "zone", "gamma", "shadow0", "shadow1", "shadow2")
"""The fields of a row that `shadow_operations` reads."""

Functions = tuple[list[Operation], Mapping[str, tuple[int, ...]]]
"""Operations, and the results of each function by its name."""

_TABLES = Table(np.zeros((1, 1)))
"""A placeholder for the tables of a rig, which are passed when a program runs."""


@cache
def lamp_operations(kind: str, *, shaped: bool, falling: bool, steps: int = 0) -> Functions:
    """Return the functions of a kind of lamp.

    Symbols are the names in `lookdev.light.lamps.FIELDS`, the components of a point p, a direction w and a normal n,
    and u1 and u2.

    ``weight``
        `lookdev.light.lamps.weight` at p and n, times the mean radiance.
    ``meet``
        Distance and density of the direction w from p.
    ``draw``
        A direction drawn by u1 and u2, its distance and density.
    ``sent``
        The radiance that arrives at p along -w, without the texture of a picture.
    ``place``
        Of a picture, the coordinates in its texture.

    A lamp that is not `shaped` emits equally in all directions, except by an IES profile, which is looked up in `steps`
    steps if these are not 0. A lamp that is not `falling` has no falloff.
    """
    graph = Graph()
    falling = falling and kind != "distant"  # a distant light is infinitely far

    def numbers(*names: str) -> tuple[Floats, ...]:
        return tuple(_number(graph, name) for name in names)

    sizes = numbers(*("a", "b")[: len(fields(SHAPES[kind]))])
    shape = Picture(sizes[0], sizes[1], _TABLES, _number(graph, "tree")) if kind == "picture" else SHAPES[kind](*sizes)
    p, w, n = (_vector(graph, name) for name in "pwn")
    cone, falloff = numbers("cone", "start", "rise", "focus"), numbers("virtual", "power", "fade", "fade_rise")
    tint, (mean,) = _numbers(graph, ["tint0", "tint1", "tint2"]), numbers("mean")
    beam = (*cone, tint.sum(axis=-1) / 3.0) if shaped else None
    radiance = _numbers(graph, ["red", "green", "blue"])
    if shaped:
        within = cone_factor(off_axis(w), *cone[:3])
        radiance = radiance * np.expand_dims(within, -1) * focus_factor(w[..., 2], cone[3], tint)
    if steps:
        profile, scale, angle_scale = numbers("profile", "profile_scale", "angle_scale")
        offset = np.maximum(profile, 0.0)
        factor = profile_factor(_TABLES, offset, steps, DEGREES * off_axis(w), azimuth(w), scale, angle_scale)
        radiance = radiance * np.expand_dims(np.where(profile >= 0.0, factor, 1.0), -1)
    if falling:
        radiance = radiance * np.expand_dims(falloff_factor(np.sqrt((p * p).sum(axis=-1)), *falloff), -1)
    direction = shape.sample(p, _numbers(graph, ["u1", "u2"]))
    outputs: dict[str, Callable[[], list[Scalar]]] = {
        "weight": lambda: elements_of(mean * weight(shape, beam, falloff if falling else None, p, n)),
        "meet": lambda: [*elements_of(shape.distance(p, w)), *elements_of(shape.pdf(p, w))],
        "draw": lambda: [
            *elements_of(direction),
            *elements_of(shape.distance(p, direction)),
            *elements_of(shape.pdf(p, direction)),
        ],
        "sent": lambda: elements_of(radiance),
    }
    if kind == "picture":
        _, hit = meet_plane(p, w, *sizes)
        outputs["place"] = lambda: [*elements_of(hit.s), *elements_of(hit.t)]
    return _write_functions(outputs)


@cache
def shadow_operations() -> Functions:
    """Return ``passed``, the share of a light that passes an occluder at ``distance``, from `SHADOW_FIELDS`."""
    graph = Graph()
    enable, limit, zone, gamma = (_number(graph, name) for name in SHADOW_FIELDS[:4])
    share = shadow_passed(_number(graph, "distance"), enable, limit, zone, gamma, _numbers(graph, SHADOW_FIELDS[4:]))
    return _write_functions({"passed": lambda: elements_of(share)})


@cache
def part_operations() -> Functions:
    """Return the functions of a part of a picture: from fractions part_s and part_t of its sides on, of a size in both.

    ``angle``
        Roughly the solid angle of the part from p (`lookdev.light.picture`).
    ``part``
        A direction to the part drawn by u1 and u2, its distance and density.
    ``density``
        The density of a direction w that meets the part.
    ``place``
        The distance along w to the whole picture, and the coordinates where w meets it.
    """
    graph = Graph()
    width, height, s, t, size = (_number(graph, name) for name in ("a", "b", "part_s", "part_t", "size"))
    p, w = (_vector(graph, name) for name in "pw")
    part = seen_part(p, width, height, s, t, size)

    def pdf(point: Point) -> Floats:
        within = [np.clip((coordinate - start) / size, 0.0, 1.0) for coordinate, start in ((point.s, s), (point.t, t))]
        value: Floats = density(part, Point(within[0], within[1], point.x, point.y))
        return value

    distance, hit = meet_plane(p, w, width, height)
    direction = towards_plane(p, draw(part, _numbers(graph, ["u1", "u2"])))
    direction_distance, direction_hit = meet_plane(p, direction, width, height)
    angle = seen_part(p, width, height, s, t, size, CELL_SEGMENTS).solid_angle
    return _write_functions(
        {
            "angle": lambda: elements_of(angle),
            "place": lambda: [*elements_of(distance), *elements_of(hit.s), *elements_of(hit.t)],
            "density": lambda: elements_of(pdf(hit)),
            "part": lambda: [
                *elements_of(direction),
                *elements_of(direction_distance),
                *elements_of(pdf(direction_hit)),
            ],
        }
    )


@cache
def ball_operations() -> Functions:
    """Return the functions of a local dome, from a and b of its row.

    ``share``
        The share of its light that arrives at p.
    ``meet``
        Whether a direction w from p meets the dome, the distance, and the solid angle at the dome's centre over the
        solid angle at p.
    ``draw``
        The direction from p to the point where the direction `onto` from the centre meets the dome.
    """
    graph = Graph()
    start, radius = (_number(graph, name) for name in "ab")
    p, w, onto = (_vector(graph, name) for name in ("p", "w", "onto"))
    hits, distance, around = meet_ball(p, w, radius)
    inside = np.where(hits, 1.0, 0.0)
    return _write_functions(
        {
            "share": lambda: elements_of(share_within(p, start, radius)),
            "meet": lambda: [*elements_of(inside), *elements_of(distance), *elements_of(around)],
            "draw": lambda: elements_of(towards_ball(p, onto, radius)),
        }
    )


def _vector(graph: Graph, name: str) -> Floats:
    return _numbers(graph, [f"{name}[{i}]" for i in range(3)])


def _numbers(graph: Graph, names: Sequence[str]) -> Floats:
    return cast("Floats", symbols(graph, names))  # the functions of lights run on symbols, too


def _number(graph: Graph, name: str) -> Floats:
    return cast("Floats", symbol(graph, name))


def _write_functions(outputs: Mapping[str, Callable[[], list[Scalar]]]) -> Functions:
    writer = ProgramWriter()
    for name, trace_outputs in outputs.items():
        writer.add(name, trace_outputs())
    assert not writer.constants, "lights have no uniforms"
    return writer.operations, writer.outputs
