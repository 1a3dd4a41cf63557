"""Updates mutants after names in the code were changed.

Each function is compared, token by token, with its text at an earlier revision. If only names and messages differ, the
new ones are put into the text of the mutant.
"""

import difflib
import io
import keyword
import re
import subprocess
import textwrap
import tokenize
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from mutant import ROOT, Mutant, functions_of, locate, mutated_source, places_of

_LAYOUT = {tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.COMMENT, tokenize.ENDMARKER}


@dataclass(frozen=True)
class Token:
    """A token of a function, and its line in the module. `is_member`: it is an attribute or a keyword argument."""

    text: str
    line: int
    is_name: bool
    is_member: bool

    @property
    def shape(self) -> str:
        """The part of the token that does not change if only names and messages are changed."""
        return "name" if self.is_name else "string" if self.text[:1] in "\"'" or self.text[1:2] in "\"'" else self.text


def tokens_of(lines: Sequence[str], first: int, last: int) -> list[Token]:
    """Return the tokens of a module's lines from `first` to `last` (counted from 1), without layout and docstrings."""
    text = "\n".join(lines[first - 1 : last]) + "\n"
    indentation = len(text) - len(text.lstrip())
    text = re.sub(rf"(?m)^ {{{indentation}}}", "", text)
    tokens = [token for token in tokenize.generate_tokens(io.StringIO(text).readline) if token.type not in _LAYOUT]
    result: list[Token] = []
    for number, token in enumerate(tokens):
        before = tokens[number - 1].string if number else ""
        after = tokens[number + 1].string if number + 1 < len(tokens) else ""
        if token.type == tokenize.STRING and token.line.strip().startswith(('"""', 'r"""')) and before in (":", ""):
            continue
        is_name = token.type == tokenize.NAME and not keyword.iskeyword(token.string)
        is_member = before == "." or (after == "=" and before in ("(", ","))
        result.append(Token(token.string, token.start[0] + first - 1, is_name, is_member))
    return result


@cache
def old_source(revision: str, path: str) -> str:
    """Return the text of a module at a revision of git, or "" if it did not exist."""
    command = ["git", "show", f"{revision}:{path}"]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return process.stdout if process.returncode == 0 else ""


def follow(mutants: Sequence[Mutant], sources: Mapping[str, str], revision: str) -> tuple[list[Mutant], list[Mutant]]:
    """Return the mutants with the names that `sources` has, and the mutants whose code has changed in other ways.

    `sources` has the present modules by path. At `revision` the code had the names that the mutants have.
    """
    present, lost = locate(mutants, sources)
    renamed = {mutant.name: new for mutant in lost if (new := _find_renamed(mutant, sources, revision)) is not None}
    return [*present, *renamed.values()], [mutant for mutant in lost if mutant.name not in renamed]


def _find_renamed(mutant: Mutant, sources: Mapping[str, str], revision: str) -> Mutant | None:
    """Return a mutant with its present names, or None if no present function differs from its old one by names only."""
    old = old_source(revision, mutant.path)
    name = mutant.function.partition(":")[2]
    ranges = [(first, last) for function, first, last in functions_of(old) if function == name] if old else []
    if not ranges:
        return None
    (first, last), lines = ranges[0], old.split("\n")
    places = places_of(lines, mutant.before, first, last)
    if mutant.occurrence >= len(places):
        return None
    begin = places[mutant.occurrence]
    end = begin + mutant.before.count("\n")
    # `before` are the tokens of the old function, `after` those of a present one; `k`, `a` and `b` are their indices.
    before = tokens_of(lines, first, last)
    for path, function, new_first, new_last in _candidates(mutant, name, sources):
        new_lines = sources[path].split("\n")
        after = tokens_of(new_lines, new_first, new_last)
        matcher = difflib.SequenceMatcher(None, [t.shape for t in before], [t.shape for t in after], autojunk=False)
        if matcher.ratio() < 0.9:
            continue  # too different to be the same function
        # The present token of each old one, if there is one. All tokens of the mutant's lines must have one.
        pairs = {a + k: b + k for a, b, size in matcher.get_matching_blocks() for k in range(size)}
        inside = [k for k, token in enumerate(before) if begin <= token.line <= end]
        if not inside or any(k not in pairs for k in inside):
            continue
        # The present lines of the mutant; they must not contain other tokens.
        rows = range(after[pairs[inside[0]]].line, after[pairs[inside[-1]]].line + 1)
        covered = [k for k, token in enumerate(after) if token.line in rows]
        if covered != [pairs[k] for k in inside]:
            continue
        text = textwrap.dedent("\n".join(new_lines[rows.start - 1 : rows.stop - 1]))
        names = {(before[a].text, before[a].is_member): after[b].text for a, b in pairs.items() if before[a].is_name}
        strings = {before[k].text: after[pairs[k]].text for k in inside if before[k].shape == "string"}
        occurrence = places_of(new_lines, text, new_first, new_last).index(rows.start)
        changed = _substitute(mutant.after, names, strings)
        moved = replace(mutant, function=f"{path}:{function}", before=text, after=changed, occurrence=occurrence)
        if mutated_source(sources[path], moved) is not None and moved.before != moved.after:
            return moved
    return None


def _candidates(mutant: Mutant, name: str, sources: Mapping[str, str]) -> Iterator[tuple[str, str, int, int]]:
    """Yield functions that can be the present one of a mutant, the likeliest first: path, name, first and last line.

    They are the functions of its module, that with the name `name` first, then those of this name in other modules.
    """
    here = functions_of(sources[mutant.path]) if mutant.path in sources else ()
    yield from ((mutant.path, *function) for function in sorted(here, key=lambda function: function[0] != name))
    for path, source in sources.items():
        if path != mutant.path:
            yield from ((path, *function) for function in functions_of(source) if function[0] == name)


def _substitute(text: str, names: Mapping[tuple[str, bool], str], strings: Mapping[str, str]) -> str:
    """Return the text of a fault with new names, by old name and `Token.is_member`, and new string literals."""
    for old, new in strings.items():
        text = text.replace(old, new)

    def new_name(match: re.Match[str]) -> str:
        is_member = match.string[: match.start()].endswith(".") or bool(re.match(r"=[^=]", match.string[match.end() :]))
        return names.get((match[0], is_member), match[0])

    # Every second part is a string literal, in which nothing is renamed.
    parts = re.split(r"""("[^"]*"|'[^']*')""", text)
    return "".join(part if number % 2 else re.sub(r"[A-Za-z_]\w*", new_name, part) for number, part in enumerate(parts))
