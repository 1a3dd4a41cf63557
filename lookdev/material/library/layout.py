"""Restores the author's layout in a USD text file after an edit: comments, blank lines, the order of statements.

USD writes a layer in its own layout, without ``#`` comments. This module therefore merges three texts, statement by
statement: the author's text, the same layer as USD writes it, and the edited layer as USD writes it. A statement that
is equal in the last two keeps the author's text.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from pxr import Sdf, Tf

# The tokens of USD's text format, as far as they matter for finding the ends of statements.
_TOKEN = re.compile(
    r'(?P<string>"""(?:\\.|[^\\])*?"""|\'\'\'(?:\\.|[^\\])*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\')'
    r"|(?P<asset>@@@.*?@@@|@[^@\n]*@)|(?P<comment>#[^\n]*)|(?P<open>[\[({])|(?P<close>[\])}])|(?P<line>\n)"
    r"|(?P<other>[ \t\r]+|[^\s\"'@#\[\](){};][^\"'@#\[\](){};\n]*|.)",
    re.DOTALL,
)


@dataclass
class _Block:
    """The statements between two brackets, or of a whole text.

    `close` is the white space and comments between the last statement and the closing bracket.
    """

    statements: list[_Statement] = field(default_factory=list)
    close: str = ""


@dataclass
class _Statement:
    """A statement of a USD text file.

    lead : the blank lines and comments above the statement.
    head : the text of the statement. For a prim, a variant set or a variant, it ends before the first bracket.
    meta : the metadata in brackets () of a prim, a variant set or a variant; else None.
    body : the block in braces {} of a prim, a variant set or a variant; else None.
    trail : the comment behind the statement.
    gaps : the white space and comments before `meta` and `body`, by the opening bracket ``"("`` or ``"{"``.
    """

    lead: str = ""
    head: str = ""
    meta: _Block | None = None
    body: _Block | None = None
    trail: str = ""
    gaps: dict[str, str] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """The words before the value, which identify the same statement in the other texts."""
        if self.meta is not None or self.body is not None:
            return " ".join(self.head.rstrip("= \n").split())
        return " ".join(self.head.partition("=")[0].split())

    @property
    def content(self) -> tuple[str, ...]:
        """The texts inside the statement. In USD's own layout, prims have equal content if only their names differ."""
        inside = [statement for block in (self.meta, self.body) if block for statement in block.statements]
        return (
            self.head.strip() if not inside else "",
            *(text for statement in inside for text in (statement.key, *statement.content)),
        )


class _Reader:
    """Splits the text of a USD file into blocks and statements. `_index` is the index of the next token."""

    def __init__(self, text: str) -> None:
        self._tokens = [(match.lastgroup or "", match[0]) for match in _TOKEN.finditer(text)]
        self._index = 0

    def read_block(self) -> _Block:
        """Read the statements up to a closing bracket, or up to the end of the text."""
        block = _Block()
        while True:
            lead = self._read_trivia()
            kind, _ = self._peek()
            if kind in ("", "close"):
                self._index += 1
                block.close = lead
                return block
            block.statements.append(self._read_statement(lead))

    def _peek(self) -> tuple[str, str]:
        """Return the kind (a group of `_TOKEN`) and the text of the next token; both are "" at the end."""
        return self._tokens[self._index] if self._index < len(self._tokens) else ("", "")

    def _read_trivia(self) -> str:
        """Read and return white space, comments and semicolons."""
        trivia = []
        while (token := self._peek())[0] in ("comment", "line") or token[1].isspace() or token[1] == ";":
            trivia.append(token[1])
            self._index += 1
        return "".join(trivia)

    def _read_statement(self, lead: str) -> _Statement:
        """Read a statement; `lead` is the text above it, which is read already."""
        # `depth` counts the open brackets of a value. `gap` is the space that is read but belongs to no part yet.
        statement, depth, gap = _Statement(lead), 0, ""
        head: list[str] = []
        while True:
            kind, text = self._peek()
            if depth and kind:  # inside a value: this branch makes long arrays fast
                depth += (kind == "open") - (kind == "close")
                head.append(text)
                self._index += 1
                continue
            words = "".join(head)
            blank = words[len(words.rstrip()) :] if statement.meta is None and statement.body is None else ""
            if depth == 0 and kind == "open" and text != "[" and ("=" not in words or _is_variant_set(words)):
                statement.gaps[text] = gap or blank
                self._index, gap = self._index + 1, ""
                block = self.read_block()
                if text == "(":
                    statement.meta = block
                else:
                    statement.body = block
            elif kind == "" or (depth == 0 and kind in ("line", "comment", "close")) or (depth == 0 and text == ";"):
                can_continue = kind in ("line", "comment") and statement.body is None and words.strip()
                if can_continue and self._continues_below(words):
                    gap = (gap or blank) + text
                    self._index += 1
                    continue
                break
            else:
                depth += (kind == "open") - (kind == "close")
                if gap or statement.meta is not None or statement.body is not None:
                    gap += text
                else:
                    head.append(text)
                self._index += 1
        statement.head = words.rstrip()
        if self._peek()[0] == "comment":
            statement.trail = (gap or blank) + self._peek()[1]
            self._index += 1
        return statement

    def _continues_below(self, words: str) -> bool:
        """Return whether a prim, variant set or variant of head `words` has its opening bracket on a line below."""
        if "=" in words and not _is_variant_set(words):
            return False
        index = self._index
        while index < len(self._tokens) and (self._tokens[index][1].isspace() or self._tokens[index][0] == "comment"):
            index += 1
        return index < len(self._tokens) and self._tokens[index][1] in "({"


def _is_variant_set(words: str) -> bool:
    """Return whether a statement is a variant set, whose head contains "=" although it has a body."""
    return words.split()[:1] == ["variantSet"]


def _statement_text(statement: _Statement) -> str:
    """Return the text of a statement, with the comments before and behind it."""
    text, gaps = statement.lead + statement.head, statement.gaps
    if statement.meta is not None:
        text += gaps["("] + "(" + _block_text(statement.meta) + ")"
    if statement.body is not None:
        text += gaps["{"] + "{" + _block_text(statement.body) + "}"
    return text + statement.trail


def _block_text(block: _Block) -> str:
    """Return the text of a block, without its brackets."""
    return "".join(map(_statement_text, block.statements)) + block.close


def _merge(author: _Block | None, before: _Block | None, after: _Block | None) -> _Block | None:
    """Return the author's block with the changes from `before` to `after`, the same block as USD writes it."""
    if author is None or before is None or after is None:
        return after
    old, new = ({statement.key: statement for statement in block.statements} for block in (before, after))
    renamed = _renamed_keys(before.statements, after.statements)
    merged: dict[str, _Statement] = {}
    header = ""  # comments above removed statements, for the next statement that stays
    for statement in author.statements:
        key = renamed.get(statement.key, statement.key)
        if key not in new:
            # Comments above a blank line do not belong to the removed statement.
            header += statement.lead.rpartition("\n\n")[0]
            continue
        previous, current = old.get(statement.key), new[key]
        lead, header = header + statement.lead, ""
        if previous is not None and (previous.meta or previous.body or current.meta or current.body):
            head = statement.head if key == statement.key else current.head
            gaps, meta = current.gaps | statement.gaps, _merge(statement.meta, previous.meta, current.meta)
            body = _merge(statement.body, previous.body, current.body)
            merged[key] = replace(statement, lead=lead, head=head, meta=meta, body=body, gaps=gaps)
        else:
            same = previous is not None and previous.head == current.head
            merged[key] = replace(statement, lead=lead) if same else replace(statement, lead=lead, head=current.head)
    # Statements stay in the author's order. New statements, and statements that the edit has moved, follow the
    # statement that is before them in `after`.
    moved = _moved_keys([renamed.get(statement.key, statement.key) for statement in before.statements], [*new])
    order, last = [key for key in merged if key not in moved], ""
    for statement in after.statements:
        if statement.key not in order:
            merged.setdefault(statement.key, statement)
            order.insert(order.index(last) + 1 if last else len(order), statement.key)
        last = statement.key
    return _Block([merged[key] for key in order], header + author.close)


def _moved_keys(before: Sequence[str], after: Sequence[str]) -> set[str]:
    """Return the keys that an edit has moved: keys in both sequences, in another order among the common keys."""
    common = {*before} & {*after}
    old, new = ([key for key in keys if key in common] for keys in (before, after))
    same = difflib.SequenceMatcher(None, old, new, autojunk=False).get_matching_blocks()
    return common - {key for block in same for key in old[block.a : block.a + block.size]}


def _renamed_keys(before: Sequence[_Statement], after: Sequence[_Statement]) -> dict[str, str]:
    """Return the new keys of renamed prims by their old keys.

    A prim is renamed if it is missing after the edit, and a new prim has the same content.
    """
    old, new = {statement.key for statement in before}, {statement.key for statement in after}
    removed = {statement.content: statement.key for statement in before if statement.body and statement.key not in new}
    return {
        removed[statement.content]: statement.key
        for statement in after
        if statement.body and statement.key not in old and statement.content in removed
    }


def restore_layout(author: str, before: str, after: str) -> str | None:
    """Return the text of an edited layer in its author's layout; None where the layout cannot be restored.

    `author` is the author's text, `before` the same layer as USD writes it, `after` the edited layer as USD writes it.
    """
    # The merged text must be the same layer as `after`: USD reads and writes both, and the results are compared.
    check, target = Sdf.Layer.CreateAnonymous(".usda"), Sdf.Layer.CreateAnonymous(".usda")
    try:
        merged = _merge(*(_Reader(text).read_block() for text in (author, before, after)))
        assert merged is not None, "each text is a block"
        text = _block_text(merged)
        if check.ImportFromString(text) and target.ImportFromString(after):
            return text if check.ExportToString() == target.ExportToString() else None
    except (RecursionError, Tf.ErrorException):
        return None
    return None
