"""The text of an edited USD file with its author's layout: comments, blank lines, the order of statements.

USD writes a layer in a layout of its own, without ``#`` comments. So three texts are merged by statements: the
author's, and what USD writes of it before and after the edit. Where the latter two agree, the author's text stays.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from pxr import Sdf, Tf

_TOKEN = re.compile(
    r'(?P<string>"""(?:\\.|[^\\])*?"""|\'\'\'(?:\\.|[^\\])*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\')'
    r"|(?P<asset>@@@.*?@@@|@[^@\n]*@)|(?P<comment>#[^\n]*)|(?P<open>[\[({])|(?P<close>[\])}])|(?P<line>\n)"
    r"|(?P<other>[ \t\r]+|[^\s\"'@#\[\](){};][^\"'@#\[\](){};\n]*|.)",
    re.DOTALL,
)


@dataclass
class _Block:
    """Statements between brackets: `close` is what stands between the last one and the closing bracket."""

    statements: list[_Statement] = field(default_factory=list)
    close: str = ""


@dataclass
class _Statement:
    """`lead` is the blank lines and comments above it, `trail` the comment behind it.

    Of a prim, a variant set or a variant, `head` is followed by metadata and a body, each after a `gap`; of anything
    else it is all.
    """

    lead: str = ""
    head: str = ""
    meta: _Block | None = None
    body: _Block | None = None
    trail: str = ""
    gaps: dict[str, str] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """What it is about: the words before its value."""
        if self.meta is not None or self.body is not None:
            return " ".join(self.head.rstrip("= \n").split())
        return " ".join(self.head.partition("=")[0].split())

    @property
    def plain(self) -> tuple[str, ...]:
        """Its content, for comparison within one layout."""
        inside = [each for block in (self.meta, self.body) if block for each in block.statements]
        return (self.head.strip() if not inside else "", *(text for each in inside for text in (each.key, *each.plain)))


class _Reader:
    def __init__(self, text: str) -> None:
        self._tokens = [(match.lastgroup or "", match[0]) for match in _TOKEN.finditer(text)]
        self._at = 0

    def block(self) -> _Block:
        """Read statements up to a closing bracket, or to the end."""
        found = _Block()
        while True:
            lead = self._trivia()
            kind, _ = self._peek()
            if kind in ("", "close"):
                self._at += 1
                found.close = lead
                return found
            found.statements.append(self._statement(lead))

    def _peek(self) -> tuple[str, str]:
        return self._tokens[self._at] if self._at < len(self._tokens) else ("", "")

    def _trivia(self) -> str:
        """Read blanks and comments."""
        found = []
        while (each := self._peek())[0] in ("comment", "line") or each[1].isspace() or each[1] == ";":
            found.append(each[1])
            self._at += 1
        return "".join(found)

    def _statement(self, lead: str) -> _Statement:
        made, depth, gap = _Statement(lead), 0, ""
        head: list[str] = []
        while True:
            kind, text = self._peek()
            if depth and kind:  # inside a value, which may be long
                depth += (kind == "open") - (kind == "close")
                head.append(text)
                self._at += 1
                continue
            words = "".join(head)
            blank = words[len(words.rstrip()) :] if made.meta is None and made.body is None else ""
            if depth == 0 and kind == "open" and text != "[" and ("=" not in words or _is_set(words)):
                made.gaps[text] = gap or blank
                self._at, gap = self._at + 1, ""
                block = self.block()
                if text == "(":
                    made.meta = block
                else:
                    made.body = block
            elif kind == "" or (depth == 0 and kind in ("line", "comment", "close")) or (depth == 0 and text == ";"):
                if kind in ("line", "comment") and made.body is None and words.strip() and self._continues(words):
                    gap = (gap or blank) + text
                    self._at += 1
                    continue
                break
            else:
                depth += (kind == "open") - (kind == "close")
                if gap or made.meta is not None or made.body is not None:
                    gap += text
                else:
                    head.append(text)
                self._at += 1
        made.head = words.rstrip()
        if self._peek()[0] == "comment":
            made.trail = (gap or blank) + self._peek()[1]
            self._at += 1
        return made

    def _continues(self, words: str) -> bool:
        """Return whether the brackets of a prim, a variant set or a variant are on a line below."""
        if "=" in words and not _is_set(words):
            return False
        at = self._at
        while at < len(self._tokens) and (self._tokens[at][1].isspace() or self._tokens[at][0] == "comment"):
            at += 1
        return at < len(self._tokens) and self._tokens[at][1] in "({"


def _is_set(words: str) -> bool:
    return words.split()[:1] == ["variantSet"]


def _written(statement: _Statement) -> str:
    text, gaps = statement.lead + statement.head, statement.gaps
    if statement.meta is not None:
        text += gaps["("] + "(" + _inside(statement.meta) + ")"
    if statement.body is not None:
        text += gaps["{"] + "{" + _inside(statement.body) + "}"
    return text + statement.trail


def _inside(block: _Block) -> str:
    return "".join(map(_written, block.statements)) + block.close


def _merged(own: _Block | None, before: _Block | None, after: _Block | None) -> _Block | None:
    """Return the author's block with what differs between `before` and `after`."""
    if own is None or before is None or after is None:
        return after
    old, new = ({each.key: each for each in block.statements} for block in (before, after))
    renamed = _renamed(before.statements, after.statements)
    kept: dict[str, _Statement] = {}
    header = ""
    for each in own.statements:
        key = renamed.get(each.key, each.key)
        if key not in new:
            # What stands above a blank line is no comment of the statement that goes.
            header += each.lead.rpartition("\n\n")[0]
            continue
        was, now = old.get(each.key), new[key]
        lead, header = header + each.lead, ""
        if was is not None and (was.meta or was.body or now.meta or now.body):
            head = each.head if key == each.key else now.head
            meta, body = _merged(each.meta, was.meta, now.meta), _merged(each.body, was.body, now.body)
            kept[key] = replace(each, lead=lead, head=head, meta=meta, body=body, gaps={**now.gaps, **each.gaps})
        else:
            same = was is not None and was.head == now.head
            kept[key] = replace(each, lead=lead) if same else replace(each, lead=lead, head=now.head)
    moved = _moved([renamed.get(each.key, each.key) for each in before.statements], [*new])
    order, last = [key for key in kept if key not in moved], ""
    for each in after.statements:
        if each.key not in order:
            kept.setdefault(each.key, each)
            order.insert(order.index(last) + 1 if last else len(order), each.key)
        last = each.key
    return _Block([kept[key] for key in order], header + own.close)


def _moved(before: Sequence[str], after: Sequence[str]) -> set[str]:
    """Return the keys that both have, and that stand elsewhere among those."""
    both = {*before} & {*after}
    old, new = ([key for key in keys if key in both] for keys in (before, after))
    same = difflib.SequenceMatcher(None, old, new, autojunk=False).get_matching_blocks()
    return both - {key for block in same for key in old[block.a : block.a + block.size]}


def _renamed(before: Sequence[_Statement], after: Sequence[_Statement]) -> dict[str, str]:
    """Return the new keys of prims that have a new name, and nothing else."""
    old, new = {each.key for each in before}, {each.key for each in after}
    gone = {each.plain: each.key for each in before if each.body and each.key not in new}
    return {gone[each.plain]: each.key for each in after if each.body and each.key not in old and each.plain in gone}


def with_layout(own: str, before: str, after: str) -> str | None:
    """Return the text of an edited layer in its author's layout; None where that cannot be kept.

    `own` is the author's text, `before` what USD writes of it, `after` what USD writes after the edit.
    """
    check, wanted = Sdf.Layer.CreateAnonymous(".usda"), Sdf.Layer.CreateAnonymous(".usda")
    try:
        merged = _merged(*(_Reader(text).block() for text in (own, before, after)))
        assert merged is not None, "each text is a block"
        text = _inside(merged)
        if check.ImportFromString(text) and wanted.ImportFromString(after):
            return text if check.ExportToString() == wanted.ExportToString() else None
    except (RecursionError, Tf.ErrorException):
        return None
    return None
