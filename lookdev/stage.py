"""Opening USD files of any content: USD's messages become a `LookError`, nothing goes to stderr.

USD's reader of text recurses, so that a deeply nested file overflows its stack, and it waits for ever for a named pipe.
`open_stage` checks every layer before USD reads it. Binary layers (.usdc) are not checked: a damaged one can crash the
process, and `lookdev.material.validate` reads it in another one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pxr import Ar, Sdf, Tf, Usd, UsdUtils

from lookdev.errors import Fault, LookError

_DEEPEST = 256  # brackets inside each other in a text layer; USD's stack ends at some ten thousand
_LONGEST = 400  # characters of USD's own message that ours contains
_NOT_UTF8 = "holds text that is not UTF-8"

# Text in which a bracket has no meaning. An unterminated string is as long as possible: no text takes quadratic time.
_QUOTED = re.compile(
    rb'"""(?:[^"\\]++|\\.|"(?!""))*+(?:""")?+'
    rb"|'''(?:[^'\\]++|\\.|'(?!''))*+(?:''')?+"
    rb'|"(?:[^"\\\n]++|\\.)*+"?+'
    rb"|'(?:[^'\\\n]++|\\.)*+'?+"
    rb"|@@@(?:[^@]++|@(?!@@))*+(?:@@@)?+"
    rb"|@[^@\n]*+@?+"
    rb"|\#[^\n]*+",
    re.DOTALL,
)
_STEPS = np.zeros(256, np.int8)
_STEPS[list(b"([{")] = 1
_STEPS[list(b")]}")] = -1
_OTHERS = bytes(np.flatnonzero(_STEPS == 0).astype(np.uint8))


@contextmanager
def reading(file: Path) -> Iterator[None]:
    """Turn exceptions of USD while `file` is read into a `LookError`, and keep its warnings off stderr."""
    held = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    except Tf.ErrorException as error:
        raise LookError([Fault(str(file), "", f"USD cannot open it: {_message(error)}")]) from error
    except UnicodeDecodeError as error:
        raise LookError([Fault(str(file), "", _NOT_UTF8)]) from error
    finally:
        held.TakeUncoalescedDiagnostics()


def open_stage(file: Path) -> Usd.Stage:
    """Open a USD file and all of its layers.

    Raises
    ------
    LookError
        The file is missing or is not USD; or a layer of it is not a regular file or nested too deep.
    """
    if not file.is_file():
        raise LookError([Fault(str(file), "", "is not a file" if file.exists() else "no such file")])
    with reading(file):
        layers = _open_layers(file)  # held, so that the stage finds them open
        stage = Usd.Stage.Open(str(file))
        del layers
        return stage


def dependencies(file: Path) -> set[Path]:
    """Return a USD file, its layers and its images, absolute; those of unselected variants too."""
    with reading(file):
        layers, images, _ = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(file)))
    return {Path(layer.realPath) for layer in layers} | {Path(image) for image in images}


def _message(error: Tf.ErrorException) -> str:
    try:
        return usd_words("; ".join(dict.fromkeys(part.commentary.strip() for part in error.args)))
    except UnicodeDecodeError:  # USD quotes the file
        return _NOT_UTF8


def usd_words(text: str) -> str:
    """Return a message of USD without names of its own code and of layers in memory, `shortened`."""
    text = re.sub(r"parse error matching pxr.*", "USD's syntax ends here", text)
    return shortened(re.sub(r",@anon:[^@]*@", "", text).strip())


def shortened(text: str) -> str:
    """Return the beginning of a text, for a message."""
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}… ({len(text)} characters)"


def _open_layers(file: Path) -> list[Sdf.Layer]:
    """Check and open a file and every layer that it may be composed of, those of unselected variants too."""
    root = str(file)
    layers: list[Sdf.Layer] = []
    faults: list[Fault] = []
    pending, seen = [root], {root, ""}
    while pending:
        path = pending.pop()
        if problem := _problem(Path(path)):
            faults.append(Fault(root, "", problem if path == root else f"its layer {path} {problem}"))
            continue
        try:
            layer = Sdf.Layer.FindOrOpen(path)
        except Tf.ErrorException:
            if path == root:
                raise
            continue  # composition reports it, with the prim that names it
        if layer is None:
            continue  # the same for an unknown format
        layers.append(layer)
        found = {_resolved(layer, asset) for asset in layer.GetCompositionAssetDependencies()} - seen
        seen |= found
        pending += sorted(found)
    if faults:
        raise LookError(faults)
    return layers


def _resolved(layer: Sdf.Layer, asset: str) -> str:
    """Return the file that a layer names; '' where it is missing, which composition reports."""
    try:
        identifier, _ = Sdf.Layer.SplitIdentifier(layer.ComputeAbsolutePath(asset))
        path = str(Ar.GetResolver().Resolve(identifier))
    except Tf.ErrorException:
        return ""
    return str(Ar.SplitPackageRelativePathOuter(path)[0]) if Ar.IsPackageRelativePath(path) else path


def _problem(layer: Path) -> str:
    """Return why USD must not read a file; '' where it may."""
    if not layer.is_file():
        return "is not a file"
    try:
        with layer.open("rb") as stream:
            if stream.read(5) != b"#usda":
                return ""
            text = stream.read()
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    brackets = np.frombuffer(_QUOTED.sub(b"", text).translate(None, _OTHERS), np.uint8)
    depth = int(_STEPS[brackets].cumsum().max(initial=0))
    return f"is nested {depth} brackets deep; at most {_DEEPEST} would be right" if depth > _DEEPEST else ""
