"""Functions of lights as operations: those of `lookdev.light`, traced, by the numbers of a light's row."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np

from lookdev.brdf.table import Table
from lookdev.codegen.program.written import Written
from lookdev.codegen.source import Operation
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.light.dome.local import meet_ball, share_within, towards_ball
from lookdev.light.emission import DEGREES, azimuth, cone_factor, falloff_factor, focus_factor, off_axis, shadow_passed
from lookdev.light.ies import profile_factor
from lookdev.light.lamps import SHAPES, weight
from lookdev.light.picture import CELL_SEGMENTS
from lookdev.light.plane import meet_plane, seen_part, towards_plane
from lookdev.light.rect import Picture
from lookdev.light.spherical_rectangle import Point, density, draw

SHADOW_FIELDS = ("shadow", "limit", "zone", "gamma", "shadow0", "shadow1", "shadow2")
"""The numbers of a row that `shadow_operations` reads."""

Functions = tuple[list[Operation], Mapping[str, tuple[int, ...]]]
"""Operations, and the results of each function by its name."""

_TABLES = Table(np.zeros((1, 1)))
"""Stands for the tables of a rig, which a program is run with."""


@cache
def lamp_operations(kind: str, *, shaped: bool, falling: bool, steps: int = 0) -> Functions:
    """Return the functions of a kind of lamp.

    ``weight`` is `lookdev.light.lamps.weight` times the mean radiance, of a place p and a normal n; ``meet`` distance
    and density of a direction w from p; ``draw`` a direction by u1 and u2, its distance and density; ``sent`` the
    radiance that arrives at p along -w, but for the texture of a picture, whose coordinates are ``place``. Symbols are
    `lookdev.light.lamps.FIELDS` by their names, and components of p, w and n. A lamp that is not `shaped` sends alike
    in all directions, but for its profile, if any is looked up in `steps` steps; one that is not `falling` has no
    falloff.
    """
    graph = Graph()
    falling = falling and kind != "distant"  # which is infinitely far

    def numbers(*names: str) -> tuple[Any, ...]:
        return tuple(symbol(graph, name) for name in names)

    sizes: Any = numbers(*("a", "b")[: len(fields(SHAPES[kind]))])
    shape: Any = (
        Picture(sizes[0], sizes[1], _TABLES, symbol(graph, "tree")) if kind == "picture" else SHAPES[kind](*sizes)
    )
    p, w, n = (_vector(graph, name) for name in "pwn")
    cone, fall = numbers("cone", "start", "rise", "focus"), numbers("virtual", "power", "fade", "fade_rise")
    tint, (mean,) = symbols(graph, ["tint0", "tint1", "tint2"]), numbers("mean")
    beam = (*cone, tint.sum(axis=-1) / 3.0) if shaped else None
    sent: Any = symbols(graph, ["red", "green", "blue"])
    if shaped:
        within = cone_factor(off_axis(w), *cone[:3])
        sent = sent * np.expand_dims(within, -1) * focus_factor(w[..., 2], cone[3], tint)
    if steps:
        place, scale, angle_scale = numbers("profile", "profile_scale", "angle_scale")
        start = np.maximum(place, 0.0)
        factor = profile_factor(_TABLES, start, steps, DEGREES * off_axis(w), azimuth(w), scale, angle_scale)
        sent = sent * np.expand_dims(np.where(place >= 0.0, factor, 1.0), -1)
    if falling:
        sent = sent * np.expand_dims(falloff_factor(np.sqrt((p * p).sum(axis=-1)), *fall), -1)
    drawn = shape.sample(p, symbols(graph, ["u1", "u2"]))
    outputs: dict[str, Callable[[], list[Any]]] = {
        "weight": lambda: elements_of(mean * weight(shape, beam, fall if falling else None, p, n)),
        "meet": lambda: [*elements_of(shape.distance(p, w)), *elements_of(shape.pdf(p, w))],
        "draw": lambda: [
            *elements_of(drawn),
            *elements_of(shape.distance(p, drawn)),
            *elements_of(shape.pdf(p, drawn)),
        ],
        "sent": lambda: elements_of(sent),
    }
    if kind == "picture":
        _, met = meet_plane(p, w, *sizes)
        outputs["place"] = lambda: [*elements_of(met.s), *elements_of(met.t)]
    return _written(outputs)


@cache
def shadow_operations() -> Functions:
    """Return what of a light passes an occluder at a ``distance``: ``passed``, by `SHADOW_FIELDS`."""
    graph = Graph()
    enable, limit, zone, gamma = (symbol(graph, name) for name in SHADOW_FIELDS[:4])
    passed = shadow_passed(symbol(graph, "distance"), enable, limit, zone, gamma, symbols(graph, SHADOW_FIELDS[4:]))
    return _written({"passed": lambda: elements_of(passed)})


@cache
def part_operations() -> Functions:
    """Return the functions of a part of a picture, from fractions part_s and part_t on, of a size in both.

    ``angle`` is roughly its solid angle from p (`lookdev.light.picture`); ``part`` a direction to it by u1 and u2, its
    distance and density; ``density`` that of a direction w that meets it. ``place`` is the distance along w to the
    whole, and where that is met.
    """
    graph = Graph()
    width, height, s, t, size = (symbol(graph, name) for name in ("a", "b", "part_s", "part_t", "size"))
    p, w = (_vector(graph, name) for name in "pw")
    seen = seen_part(p, width, height, s, t, size)

    def pdf(point: Point) -> Any:
        within = [np.clip((each - start) / size, 0.0, 1.0) for each, start in ((point.s, s), (point.t, t))]
        return density(seen, Point(within[0], within[1], point.x, point.y))

    distance, met = meet_plane(p, w, width, height)
    drawn = towards_plane(p, draw(seen, symbols(graph, ["u1", "u2"])))
    away, point = meet_plane(p, drawn, width, height)
    angle = seen_part(p, width, height, s, t, size, CELL_SEGMENTS).solid_angle
    return _written(
        {
            "angle": lambda: elements_of(angle),
            "place": lambda: [*elements_of(distance), *elements_of(met.s), *elements_of(met.t)],
            "density": lambda: elements_of(pdf(met)),
            "part": lambda: [*elements_of(drawn), *elements_of(away), *elements_of(pdf(point))],
        }
    )


@cache
def ball_operations() -> Functions:
    """Return the functions of a local dome, by its row's a and b.

    ``share`` is of its light at p; ``meet`` whether a direction w from p meets it, the distance, and the solid angle
    around p for that around the middle; ``draw`` the direction to where `onto` meets it.
    """
    graph = Graph()
    start, radius = (symbol(graph, name) for name in "ab")
    p, w, onto = (_vector(graph, name) for name in ("p", "w", "onto"))
    met, distance, around = meet_ball(p, w, radius)
    inside = np.where(met, 1.0, 0.0)
    return _written(
        {
            "share": lambda: elements_of(share_within(p, start, radius)),
            "meet": lambda: [*elements_of(inside), *elements_of(distance), *elements_of(around)],
            "draw": lambda: elements_of(towards_ball(p, onto, radius)),
        }
    )


def _vector(graph: Graph, name: str) -> Any:
    return symbols(graph, [f"{name}[{i}]" for i in range(3)])


def _written(outputs: Mapping[str, Callable[[], list[Any]]]) -> Functions:
    written = Written()
    for name, traced in outputs.items():
        written.add(name, traced())
    assert not written.constants, "lights have no uniforms"
    return written.operations, written.outputs
