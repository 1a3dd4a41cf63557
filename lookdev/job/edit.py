"""Edits of the materials that a job assigns to parts, in the job's text, for `lookdev design`.

The rest of the text stays as it is, including comments. A job is a list of TOML tables. A look is a table ``[[look]]``;
an *assign* is one of its tables ``[[look.assign]]``, with a material and the prims to which it is assigned. An edit
finds the lines of these tables, and TOML Kit edits the keys of one table in the layout of that table. If the looks or
the assigns are inline tables, TOML Kit edits all of them. The result is parsed and compared with the data that the edit
should give; other data are an error.
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

_Data = dict[str, Any]  # a TOML table: values by key


@dataclass(frozen=True)
class AssignedMaterial:
    """A material that a job assigns.

    `material` is the path of its file as the job has it. `prim` is its prim if the job names one. `variants` has the
    variant that is chosen in each variant set.
    """

    material: str
    prim: str | None = None
    variants: Mapping[str, str] = field(default_factory=dict)

    @property
    def keys(self) -> _Data:
        """The keys, with their values, of a table that assigns the material."""
        prim = {"prim": self.prim} if self.prim else {}
        return {"material": self.material, **prim, **({"variants": dict(self.variants)} if self.variants else {})}


_MATERIAL_KEYS = ("material", "prim", "variants")


def assign_material(
    text: str, look: int, prims: Sequence[str], material: AssignedMaterial, covering: int | None = None
) -> str:
    """Return a job's text in which a look assigns a material to prims; `look` is the look's index in the file.

    `covering` is the index of the assign whose material the parts of these prims have now, or None. If an assign has
    exactly these prims, and its index is `covering` or `covering` is None, its material is replaced. Otherwise the
    prims are removed from all assigns that name them. A new assign is then inserted before the one at `covering`, or at
    the end.
    """

    def edit_assigns(assigns: list[_Data]) -> list[tuple[int | None, _Data]]:
        same = next((number for number, table in enumerate(assigns) if set(table["prims"]) == set(prims)), None)
        if same is not None and covering in (None, same):
            other_keys = {key: value for key, value in assigns[same].items() if key not in _MATERIAL_KEYS}
            edited = {**other_keys, **material.keys}
            return [(number, edited if number == same else table) for number, table in enumerate(assigns)]
        remaining = [*_remove_prims(assigns, prims)]
        position = len(remaining) if covering is None else sum(number < covering for number, _ in remaining)
        return [*remaining[:position], (None, {"prims": list(prims), **material.keys}), *remaining[position:]]

    return _edit_look(text, look, {}, edit_assigns)


def assign_to_rest(text: str, look: int, material: AssignedMaterial) -> str:
    """Return a job's text in which a look has a `material`, for all parts without a material from an assign."""
    return _edit_look(text, look, material.keys, lambda assigns: [*enumerate(assigns)])


def unassign(text: str, look: int, prims: Iterable[str]) -> str:
    """Return a job's text in which no assign of a look names the given prims; an assign without prims is removed."""
    removed = list(prims)
    return _edit_look(text, look, {}, lambda assigns: [*_remove_prims(assigns, removed)])


def _remove_prims(assigns: Sequence[_Data], prims: Sequence[str]) -> Iterable[tuple[int, _Data]]:
    """Yield the assigns without the given prims, with their indices; assigns that have no other prims are left out."""
    for number, table in enumerate(assigns):
        remaining = [prim for prim in table["prims"] if prim not in prims]
        if remaining:
            yield number, table if remaining == table["prims"] else {**table, "prims": remaining}


def _edit_look(text: str, look: int, keys: _Data, edit: Callable[[list[_Data]], list[tuple[int | None, _Data]]]) -> str:
    """Return the text of a job with edited assigns of a look.

    `edit` takes the assigns, and returns pairs: the index of an assign in the file, and its edited table. An additional
    assign has the index None. `keys` has new values of the look's `_MATERIAL_KEYS`; if it is empty, the values stay as
    they are.
    """
    if "\r\n" in text:
        return _edit_look(text.replace("\r\n", "\n"), look, keys, edit).replace("\n", "\r\n")
    data = tomllib.loads(text)
    looks = data.get("look")
    if not isinstance(looks, list) or not 0 <= look < len(looks):
        raise LookdevError(f"the job has no look of number {look}")
    assigns = edit(copy.deepcopy(looks[look].get("assign", [])))
    expected = copy.deepcopy(data)
    expected["look"][look] = _updated_look(expected["look"][look], keys, [table for _, table in assigns])
    try:
        result = _edit_blocks(text, look, keys, assigns)
        result_data = tomllib.loads(result)
    except (TOMLKitError, tomllib.TOMLDecodeError, KeyError, IndexError, TypeError) as error:
        raise LookdevError(_UNSUPPORTED_LAYOUT) from error
    if result_data != expected:
        raise LookdevError(_UNSUPPORTED_LAYOUT)
    return result


_UNSUPPORTED_LAYOUT = (
    "the job's [[look]] has a layout that cannot be edited here; edit the job as text, and load it again"
)


def _updated_look(table: _Data, keys: _Data, assigns: list[_Data]) -> _Data:
    """Return the table of a look with new assigns and, unless `keys` is empty, new values of `_MATERIAL_KEYS`."""
    unchanged = {key: value for key, value in table.items() if not (keys and key in _MATERIAL_KEYS) and key != "assign"}
    return {**unchanged, **keys, **({"assign": assigns} if assigns else {})}


@dataclass
class _Block:
    """The lines of a table with a header, ``[keys]``, or ``[[keys]]`` if it is an item of an array of tables.

    `keys` are the keys of the header, split at dots. Line `start` is the header, and `end` is the line after the last
    statement of the table. `above` is the first line of the comments directly above the header.
    """

    keys: tuple[str, ...]
    is_array_item: bool
    above: int
    start: int
    end: int


def _blocks(lines: Sequence[str]) -> list[_Block]:
    """Return the tables with headers of a text, in their order; statements may have several lines."""
    blocks: list[_Block] = []
    line, above = 0, 0
    while line < len(lines):
        stripped = lines[line].strip()
        if not stripped:
            line += 1
            above = line
        elif stripped.startswith("#"):
            line += 1
        elif stripped.startswith("["):
            keys, inner = [], tomllib.loads(lines[line])
            is_array_item = False
            while inner:
                ((key, value),) = inner.items()
                keys.append(key)
                is_array_item = isinstance(value, list)
                inner = value[0] if is_array_item else value
            blocks.append(_Block(tuple(keys), is_array_item, above, line, line + 1))
            line += 1
            above = line
        else:
            line = _statement_end(lines, line)
            above = line
            if blocks:
                blocks[-1].end = line
    return blocks


def _statement_end(lines: Sequence[str], start: int) -> int:
    """Return the line after the statement that begins at line `start`."""
    for end in range(start + 1, len(lines) + 1):
        try:
            tomllib.loads("".join(lines[start:end]))
        except tomllib.TOMLDecodeError:
            continue
        return end
    raise LookdevError(_UNSUPPORTED_LAYOUT)


def _edit_blocks(text: str, look: int, keys: _Data, assigns: list[tuple[int | None, _Data]]) -> str:
    """Return the text of a job with new assigns and `keys` of a look; `_edit_look` checks the result."""
    lines = re.findall(r"[^\n]*\n|[^\n]+$", text)
    blocks = _blocks(lines)
    look_blocks = [number for number, block in enumerate(blocks) if block.keys == ("look",) and block.is_array_item]
    if not look_blocks:
        return _edit_inline(text, look, keys, assigns)
    look_block = blocks[look_blocks[look]]
    following = blocks[look_blocks[look] + 1 : look_blocks[look + 1] if look + 1 < len(look_blocks) else len(blocks)]
    assign_blocks = [block for block in following if block.keys == ("look", "assign") and block.is_array_item]
    last = look_block
    for block in following:  # a subtable of an assign, such as [look.assign.variants], belongs to the assign's block
        if block.keys[:1] != ("look",):
            continue
        if block.keys[:2] == ("look", "assign") and not block.is_array_item:
            [parent for parent in assign_blocks if parent.start < block.start][-1].end = block.end
        last = block if block.end > last.end else last
    edits: list[tuple[int, int, str]] = []  # first line, line after the last, and the text that replaces them
    body = "".join(lines[look_block.start + 1 : look_block.end])
    document = tomlkit.parse(body)
    retained = [number for number, _ in assigns if number is not None]
    if "assign" in document:
        _set_inline_assigns(document, assigns)
    else:
        for number, block in enumerate(assign_blocks):
            if number not in retained:
                # If there are blank lines before and after the assign, one of them is removed with it.
                blank = block.end < len(lines) and not lines[block.end].strip() and not lines[block.start - 1].strip()
                edits.append((block.start, block.end + blank, ""))
        for index, table in assigns:
            if index is not None:
                block = assign_blocks[index]
                edits.append((block.start + 1, block.end, _edit_assign(lines[block.start + 1 : block.end], table)))
        edits += _new_blocks(lines, assign_blocks, last, assigns)
    if keys:
        _set_values(document, keys, _MATERIAL_KEYS)
    if (edited_body := document.as_string()) != body:
        edits.append((look_block.start + 1, look_block.end, edited_body))
    # Edits are applied from the last line to the first. At one line, a removal is applied before an insertion.
    for start, end, replacement in sorted(edits, key=lambda edit: (edit[0], edit[1]), reverse=True):
        lines[start:end] = [replacement.removesuffix("\n") + "\n"] if replacement else []
    return "".join(lines)


def _new_blocks(
    lines: Sequence[str], blocks: Sequence[_Block], last: _Block, assigns: Sequence[tuple[int | None, _Data]]
) -> Iterable[tuple[int, int, str]]:
    """Yield the edits that insert additional assigns: before the next assign of the file, else after the block `last`.

    `blocks` are the blocks of the assigns in the file. An edit is a tuple: the first line that it replaces, the line
    after the last one, and the new text.
    """
    for position, (number, table) in enumerate(assigns):
        if number is not None:
            continue
        block = "[[look.assign]]\n" + "".join(f"{key} = {_format_value(value)}\n" for key, value in table.items())
        later = next((number for number, _ in assigns[position + 1 :] if number is not None), None)
        if later is not None:
            yield blocks[later].above, blocks[later].above, f"{block}\n"
        else:
            end = last.end
            gap = "" if lines[end - 1].endswith("\n") else "\n"
            yield end, end, f"{gap}\n{block}"


def _edit_assign(lines: Sequence[str], table: _Data) -> str:
    """Return the text of an assign with the values of `table`, in the layout of its old lines."""
    body = "".join(lines)
    # Parsed alone, the assign is the root: its subtables, such as [look.assign.variants], become [variants].
    document = tomlkit.parse(re.sub(r"(?m)^(\s*\[)look\s*\.\s*assign\s*\.\s*", r"\1", body))
    if document.unwrap() == table:
        return body
    _set_values(document, table)
    # The headers of subtables get their full names again.
    return re.sub(r"(?m)^(\s*\[)(?=[^\[\n]*\]\s*(#.*)?$)", r"\1look.assign.", document.as_string())


def _edit_inline(text: str, look: int, keys: _Data, assigns: list[tuple[int | None, _Data]]) -> str:
    """Return the text of a job whose looks are inline tables, with new assigns and `keys` of a look."""
    document = tomlkit.parse(text)
    table = document["look"][look]
    if keys:
        _set_values(table, keys, _MATERIAL_KEYS)
    _set_inline_assigns(table, assigns)
    return document.as_string()


def _set_inline_assigns(table: Any, assigns: Sequence[tuple[int | None, _Data]]) -> None:
    """Replace the assigns of a look, which are an array of inline tables."""
    if not assigns:
        table.pop("assign", None)
        return
    if "assign" not in table:
        table["assign"] = tomlkit.array()
    array = table["assign"]
    retained = [number for number, _ in assigns if number is not None]
    for removed in sorted({*range(len(array))} - {*retained}, reverse=True):
        del array[removed]
    for position, (number, values) in enumerate(assigns):
        if number is None:
            array.insert(position, _toml_item(values))
        else:
            _set_values(array[position], values)


def _set_values(table: Any, values: _Data, replaced: Iterable[str] = ()) -> None:
    """Set the values of a TOML Kit table, and delete keys that have no new value.

    Only keys in `replaced` are deleted; if it is empty, any key is. If prims are only removed from a list of prims, the
    layout of the list is kept.
    """
    for key in [key for key in replaced or table if key in table and key not in values]:
        del table[key]
    for key, value in values.items():
        if key in table and table[key] == value:
            continue
        if key == "prims" and key in table:
            array = table[key]
            for index in reversed(range(len(array))):
                if array[index] not in value:
                    del array[index]
            if list(array) == value:
                continue
        table[key] = _toml_item(value)


def _toml_item(value: Any) -> Any:
    return tomlkit.value(_format_value(value))


def _format_value(value: Any) -> str:
    """Return a value of an assign as TOML."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_format_key(key)} = {_format_value(item)}' for key, item in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_format_value, value))}]"
    return json.dumps(value, ensure_ascii=False)


def _format_key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key, ensure_ascii=False)
