"""Editing what parts wear, in the text of a job: all that is not edited stays to the letter, comments too.

A job is a list of tables, so an edit is one of lines: those of ``[[look]]`` and its ``[[look.assign]]`` are found, and
TOML Kit edits the keys of one table in its own layout. Where the looks or the assigns are inline, it edits all of them.
What results must be the data that the edit is meant to make, or nothing is returned.
"""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from lookdev.errors import LookdevError

_Data = dict[str, Any]


@dataclass(frozen=True)
class Wear:
    """A material of the job: its path as the job has it, its prim where that is named, and its variants."""

    material: str
    prim: str | None = None
    variants: Mapping[str, str] = field(default_factory=dict)

    @property
    def keys(self) -> _Data:
        """The keys of a table that wears it."""
        prim = {"prim": self.prim} if self.prim else {}
        return {"material": self.material, **prim, **({"variants": dict(self.variants)} if self.variants else {})}


_WORN = ("material", "prim", "variants")


def assign(text: str, look: int, prims: Sequence[str], worn: Wear, covering: int | None = None) -> str:
    """Return a job's text in which prims wear a material in a look, which is numbered as in the file.

    An `assign` of these prims takes the material. Otherwise there is a new one before `covering`, the number of the
    `assign` that covers a part of them now, else after all; the prims are taken out of others that name them.
    """

    def edited(assigns: list[_Data]) -> list[tuple[int | None, _Data]]:
        same = next((n for n, each in enumerate(assigns) if set(each["prims"]) == set(prims)), None)
        if same is not None and covering in (None, same):
            kept = {key: value for key, value in assigns[same].items() if key not in _WORN}
            return [(n, {**kept, **worn.keys} if n == same else each) for n, each in enumerate(assigns)]
        place = len(assigns) if covering is None else covering
        rest = [*_without(assigns, prims)]
        new: tuple[int | None, _Data] = (None, {"prims": list(prims), **worn.keys})
        return [
            *(each for each in rest if each[0] is not None and each[0] < place),
            new,
            *(each for each in rest if each[0] is not None and each[0] >= place),
        ]

    return _edited(text, look, {}, edited)


def wear_all(text: str, look: int, worn: Wear) -> str:
    """Return a job's text whose look wears a material wherever nothing is assigned."""
    return _edited(text, look, worn.keys, lambda assigns: [*enumerate(assigns)])


def unassign(text: str, look: int, prims: Iterable[str]) -> str:
    """Return a job's text without prims in the assigns of a look; an assign without any is removed."""
    taken = list(prims)
    return _edited(text, look, {}, lambda assigns: [*_without(assigns, taken)])


def _without(assigns: Sequence[_Data], prims: Sequence[str]) -> Iterable[tuple[int | None, _Data]]:
    for number, each in enumerate(assigns):
        left = [prim for prim in each["prims"] if prim not in prims]
        if left:
            yield number, each if left == each["prims"] else {**each, "prims": left}


def _edited(text: str, look: int, keys: _Data, edit: Callable[[list[_Data]], list[tuple[int | None, _Data]]]) -> str:
    """Return the text of a job with another `assign` of a look, each with the number that it had, and other `keys`."""
    if "\r\n" in text:
        return _edited(text.replace("\r\n", "\n"), look, keys, edit).replace("\n", "\r\n")
    data = tomllib.loads(text)
    looks = data.get("look")
    if not isinstance(looks, list) or not 0 <= look < len(looks):
        raise LookdevError(f"the job has no look of number {look}")
    assigns = edit(copy.deepcopy(looks[look].get("assign", [])))
    wanted = copy.deepcopy(data)
    wanted["look"][look] = _worn(wanted["look"][look], keys, [each for _, each in assigns])
    lines = _lines(text)
    blocks = _blocks(lines)
    try:
        if not any(block.keys == ("look",) and block.listed for block in blocks):
            made = _inline(text, look, keys, assigns)
        else:
            made = _in_blocks(lines, blocks, look, keys, assigns)
        found = tomllib.loads(made)
    except (TOMLKitError, tomllib.TOMLDecodeError, KeyError, IndexError, TypeError) as error:
        raise LookdevError(_HAND) from error
    if found != wanted:
        raise LookdevError(_HAND)
    return made


_HAND = "the layout of the job's [[look]] is not one that is edited here: edit the job as text, and load it"


def _worn(table: _Data, keys: _Data, assigns: list[_Data]) -> _Data:
    """Return a look with other keys of its material and other assigns."""
    kept = {key: value for key, value in table.items() if not (keys and key in _WORN) and key != "assign"}
    return {**kept, **keys, **({"assign": assigns} if assigns else {})}


@dataclass
class _Block:
    """A table of the file: its header's keys, and whether it is one of a list; lines `start` to before `end`.

    `start` is that of the header, `above` that of the comments directly above it, `end` is after its last statement.
    """

    keys: tuple[str, ...]
    listed: bool
    above: int
    start: int
    end: int


def _lines(text: str) -> list[str]:
    return re.findall(r"[^\n]*\n|[^\n]+$", text)


def _blocks(lines: Sequence[str]) -> list[_Block]:
    """Return the tables of a text; a statement of several lines is read as a whole."""
    blocks: list[_Block] = []
    at, above = 0, 0
    while at < len(lines):
        bare = lines[at].strip()
        if not bare:
            at += 1
            above = at
        elif bare.startswith("#"):
            at += 1
        elif bare.startswith("["):
            keys, inner = [], tomllib.loads(lines[at])
            listed = False
            while inner:
                ((key, value),) = inner.items()
                keys.append(key)
                listed = isinstance(value, list)
                inner = value[0] if listed else value
            blocks.append(_Block(tuple(keys), listed, above, at, at + 1))
            at += 1
            above = at
        else:
            at = _after(lines, at)
            above = at
            if blocks:
                blocks[-1].end = at
    return blocks


def _after(lines: Sequence[str], start: int) -> int:
    for end in range(start + 1, len(lines) + 1):
        try:
            tomllib.loads("".join(lines[start:end]))
        except tomllib.TOMLDecodeError:
            continue
        return end
    raise LookdevError(_HAND)


def _in_blocks(
    lines: list[str], blocks: list[_Block], look: int, keys: _Data, assigns: list[tuple[int | None, _Data]]
) -> str:
    """Return the lines of a job whose looks have headers of their own."""
    firsts = [n for n, block in enumerate(blocks) if block.keys == ("look",) and block.listed]
    own = blocks[firsts[look]]
    after = blocks[firsts[look] + 1 : firsts[look + 1] if look + 1 < len(firsts) else len(blocks)]
    tables = [block for block in after if block.keys == ("look", "assign") and block.listed]
    last = own
    for block in after:  # what belongs to an assign, as [look.assign.variants], ends with it
        if block.keys[:1] != ("look",):
            continue
        if block.keys[:2] == ("look", "assign") and not block.listed:
            [each for each in tables if each.start < block.start][-1].end = block.end
        last = block if block.end > last.end else last
    edits: list[tuple[int, int, str]] = []  # lines that others replace
    body = "".join(lines[own.start + 1 : own.end])
    document = tomlkit.parse(body)
    had = [n for n, _ in assigns if n is not None]
    if "assign" in document:
        _set_inline(document, assigns)
    else:
        for place, block in enumerate(tables):
            if place not in had:
                blank = block.end < len(lines) and not lines[block.end].strip() and not lines[block.start - 1].strip()
                edits.append((block.start, block.end + blank, ""))
        for number, table in assigns:
            if number is not None:
                block = tables[number]
                edits.append((block.start + 1, block.end, _table(lines[block.start + 1 : block.end], table)))
        edits += _new_blocks(lines, tables, last, assigns)
    if keys:
        _set_worn(document, keys)
    if (made := document.as_string()) != body:
        edits.append((own.start + 1, own.end, made))
    # An insertion at the line at which a removal starts comes first.
    for start, end, made in sorted(edits, key=lambda each: (each[0], each[1]), reverse=True):
        lines[start:end] = [_ended(made)] if made else []
    return "".join(lines)


def _new_blocks(
    lines: Sequence[str], tables: Sequence[_Block], last: _Block, assigns: Sequence[tuple[int | None, _Data]]
) -> Iterable[tuple[int, int, str]]:
    for place, (number, table) in enumerate(assigns):
        if number is not None:
            continue
        written = "[[look.assign]]\n" + "".join(f"{key} = {_value(value)}\n" for key, value in table.items())
        later = next((n for n, _ in assigns[place + 1 :] if n is not None), None)
        if later is not None:
            yield tables[later].above, tables[later].above, f"{written}\n"
        else:
            end = last.end
            gap = "" if lines[end - 1].endswith("\n") else "\n"
            yield end, end, f"{gap}\n{written}"


def _table(lines: Sequence[str], table: _Data) -> str:
    """Return the lines of an assign with other values, in its own layout."""
    body = "".join(lines)
    # The tables of an assign, as [look.assign.variants], are those of a document that is the assign.
    document = tomlkit.parse(re.sub(r"(?m)^(\s*\[)look\s*\.\s*assign\s*\.\s*", r"\1", body))
    if document.unwrap() == table:
        return body
    _set(document, table)
    return re.sub(r"(?m)^(\s*\[)(?=[^\[\n]*\]\s*(#.*)?$)", r"\1look.assign.", document.as_string())


def _inline(text: str, look: int, keys: _Data, assigns: list[tuple[int | None, _Data]]) -> str:
    document = tomlkit.parse(text)
    table = document["look"][look]
    if keys:
        _set_worn(table, keys)
    _set_inline(table, assigns)
    return document.as_string()


def _set_inline(table: Any, assigns: Sequence[tuple[int | None, _Data]]) -> None:
    """Give a table other assigns in an array."""
    if not assigns:
        table.pop("assign", None)
        return
    if "assign" not in table:
        table["assign"] = tomlkit.array()
    array = table["assign"]
    had = [number for number, _ in assigns if number is not None]
    for gone in sorted({*range(len(array))} - {*had}, reverse=True):
        del array[gone]
    for place, (number, values) in enumerate(assigns):
        if number is None:
            array.insert(place, _item(values))
        else:
            _set(array[place], values)


def _set_worn(table: Any, keys: _Data) -> None:
    for key in _WORN:
        if key in table and key not in keys:
            del table[key]
    for key, value in keys.items():
        if key not in table or table[key] != value:
            table[key] = _item(value)


def _set(table: Any, values: _Data) -> None:
    for key in [each for each in table if each not in values]:
        del table[key]
    for key, value in values.items():
        if key in table and table[key] == value:
            continue
        if key == "prims" and key in table:
            array = table[key]
            for number in reversed(range(len(array))):
                if array[number] not in value:
                    del array[number]
            if list(array) == value:
                continue
        table[key] = _item(value)


def _item(value: Any) -> Any:
    return tomlkit.value(_value(value))


def _value(value: Any) -> str:
    """Return a value of an assign as TOML."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_key(key)} = {_value(each)}' for key, each in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value, ensure_ascii=False)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key, ensure_ascii=False)


def _ended(text: str) -> str:
    return text if text.endswith("\n") else f"{text}\n"
