"""What can be wrong with the files of a USD asset and how they are composed."""

import os
import random
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from cases import ANY, ANY_MEANING, NAMED, NOTED, REFUSED
from cases import SOUND as RIGHT
from damage import Damage, append_noise, replace_by_noise, truncate
from pxr import Sdf, UsdUtils
from text_changes import NO_FILES
from usd_sound import PIXELS, SOUND, sound_layer

_CAGE = SOUND["cage"]
_BODY = _CAGE.text.split(")\n\n", 1)[1]
Write = Callable[[Path, random.Random], Path | None]
Make = Callable[[Path], object]


@dataclass(frozen=True)
class Wrong:
    """How files of the sound cage are written wrongly, with the asset's name returned, and what must become of it."""

    write: Write
    expected: frozenset[str] = REFUSED
    names: tuple[str, ...] = ("asset.",)


def _text(body: str, more: str = "") -> str:
    return f'#usda 1.0\n(\n    defaultPrim = "Root"\n    metersPerUnit = 0.5\n    upAxis = "Y"\n{more})\n\n{body}\n'


def _files(contents: Mapping[str, str | bytes]) -> Write:
    """Return what writes files; the first is the asset."""

    def write(folder: Path, rng: random.Random) -> Path:
        for name, content in contents.items():
            (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        return folder / next(iter(contents))

    return write


def _raw(content: str | bytes, name: str = "asset.usda") -> Write:
    return _files({name: content})


def _made(make: Make, name: str = "asset.usda") -> Write:
    def write(folder: Path, rng: random.Random) -> Path:
        make(folder / name)
        return folder / name

    return write


def _part(folder: Path, suffix: str = ".usda") -> Path:
    """Write the sound cage."""
    path = folder / f"part{suffix}"
    sound_layer(_CAGE).Export(str(path))
    return path


def _root(body: str, more: str = "", part: str = _CAGE.text) -> Write:
    """Return what writes a root layer beside a ``part``, which is sound by default."""
    return _files({"asset.usda": _text(body, more), "part.usda": part})


def _referring(body: str = "", more: str = "") -> str:
    """Return the text of a root prim that is the sound ``part``, and has more."""
    return f'def "Root" (references = @part.usda@</Root>{more})\n{{\n{body}}}'


def _more(arc: str) -> Write:
    """Return what writes a root layer that has a prim of an arc beside what is sound."""
    return _root(_referring(f'    def "More" ({arc})\n    {{\n    }}\n'))


def _beside(arc: str, *names: str) -> Wrong:
    return Wrong(_more(arc), names=("asset.", "/Root/More", *names))


def _odd(make: Make) -> Wrong:
    """Return an asset that refers to a file which is no layer."""

    def write(folder: Path, rng: random.Random) -> None:
        make(folder / "odd.usda")
        _more("references = @odd.usda@")(folder, rng)

    return Wrong(write, names=("asset.", "odd.usda"))


def _damaged(way: str, damage: Damage) -> Write:
    """Return what changes the bytes of the only file, or of a layer that the root references."""

    def write(folder: Path, rng: random.Random) -> Path | None:
        if way == "usdz":
            file = folder / "asset.usdz"
            UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(_part(folder, ".usdc"))), str(file))
        elif way.startswith("part"):
            file = _part(folder, way.removeprefix("part"))
            (folder / "asset.usda").write_text(_text(_referring().replace("part.usda", file.name)))
        else:
            file = _part(folder, way).rename(folder / f"asset{way}")
        file.write_bytes(damage(file.read_bytes(), rng))
        return file if not way.startswith("part") else None

    return write


def _scramble(data: bytes, rng: random.Random) -> bytes:
    """Change some bytes: of flipped bits of counts USD makes gigabytes, which only the command line refuses."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 8, 64))):
        changed[rng.randrange(8, len(changed))] = rng.randrange(256)
    return bytes(changed)


def _zip(text: str | bytes, name: str = "a.usda", method: int = zipfile.ZIP_STORED) -> Write:
    """Return what writes a package of one file, or of none."""

    def write(folder: Path, rng: random.Random) -> Path:
        with zipfile.ZipFile(folder / "asset.usdz", "w", method) as archive:
            if text:
                archive.writestr(name, text)
        return folder / "asset.usdz"

    return write


def _cage(old: str, new: str, expected: frozenset[str] = REFUSED, *names: str) -> Wrong:
    """Return the sound asset with another text in the place of one."""
    assert old in _CAGE.text
    return Wrong(_raw(_CAGE.text.replace(old, new, 1)), expected, ("asset.", *names))


def _prims(text: str, expected: frozenset[str] = REFUSED, *names: str) -> Wrong:
    """Return the sound asset with more prims in its root."""
    return Wrong(_raw(_CAGE.text.rstrip()[:-1] + text + "\n}\n"), expected, ("asset.", *names))


def _prim(kind: str, expected: frozenset[str], name: str = "More") -> Wrong:
    return _prims(f'    def {kind} "{name}"\n    {{\n    }}', expected, f"/Root/{name[:100]}")


def _nested(count: int) -> Wrong:
    """Return an asset of prims inside each other."""
    return Wrong(_raw(_text("".join(f'def "P{i}"\n{{\n' for i in range(count)) + "}\n" * count)))


_VARIANTS = 'variantSet "v" = {\n"a" {}\n"b" (references = @nowhere.usda@) {}\n}\n'
_CHOSEN = '; variants = {string v = "a"}; prepend variantSets = "v"'
_ROOT_REFERS = 'def "Root" (references = @{}@</Root>)\n{{\n}}'

FILES: dict[str, Wrong] = {
    # Arcs.
    "reference to no prim of its own": _beside("references = </Nowhere>", "Nowhere"),
    "reference to itself": _beside("references = </Root/More>"),
    "reference to its parent": _beside("references = </Root>"),
    "reference to a file without defaultPrim": _odd(lambda path: path.write_text('#usda 1.0\ndef Scope "A"\n{\n}')),
    "reference to a folder": _odd(Path.mkdir),
    "reference to a pipe": _odd(os.mkfifo),
    "reference to an image": _odd(lambda path: path.write_bytes(PIXELS)),
    "reference to a device": Wrong(_more("references = @/dev/zero@"), names=("asset.usda", "/dev/zero")),
    "reference to an unknown suffix": Wrong(_more("references = @part.usdx@"), names=("asset.usda", "part.usdx")),
    "reference with an offset that is not finite": Wrong(_more("references = @part.usda@</Root> (offset = nan)"), ANY),
    "reference with a scale of 0": Wrong(_more("references = @part.usda@</Root> (scale = 0)"), ANY),
    "sublayers in a cycle": Wrong(
        _root(_BODY, "    subLayers = [@part.usda@]\n", _text("", "    subLayers = [@asset.usda@]\n"))
    ),
    "sublayer twice": Wrong(_root(_BODY, "    subLayers = [@part.usda@, @part.usda@]\n"), RIGHT | REFUSED),
    "inherits nothing": _cage('def Xform "Root"', 'def Xform "Root" (inherits = </No>)', RIGHT),
    "inherits itself": _cage('def Xform "Root"', 'def Xform "Root" (inherits = </Root>)', REFUSED, "/Root"),
    "inherits in a long chain": Wrong(
        _raw(_CAGE.text + "\n".join(f'def "P{i}" (inherits = </P{i + 1}>)\n{{\n}}' for i in range(500))), RIGHT
    ),
    "broken reference in another variant": Wrong(_root(_referring(_VARIANTS, _CHOSEN)), RIGHT),
    # Files. Without a checksum, one changed number is another sound file.
    **{
        f"{name} {way}": Wrong(_damaged(way, damage), ANY_MEANING)
        for name, damage in {
            "truncated": truncate,
            "scrambled": _scramble,
            "noise in": replace_by_noise,
        }.items()
        for way in (".usda", ".usdc", "usdz", "part.usda", "part.usdc")
    },
    **{f"bytes after {way}": Wrong(_damaged(way, append_noise), ANY) for way in (".usda", ".usdc", "usdz")},
    **{name: Wrong(_made(make)) for name, (make, _) in NO_FILES.items()},
    "a pipe as usdc": Wrong(_made(os.mkfifo, "asset.usdc")),
    **{f"empty {suffix}": Wrong(_raw("", f"asset.{suffix}")) for suffix in ("usda", "usdc", "usdz")},
    "an image": Wrong(_raw(PIXELS)),
    "an image as usdc": Wrong(_raw(PIXELS, "asset.usdc")),
    "UTF-16": Wrong(_raw(_CAGE.text.encode("utf-16"))),
    "escapes in a string": _cage('"loop"', '"\x1b[2J\x1b]0;x\x07"'),
    "an unknown version": _cage("1.0", "9.0"),
    "an unknown suffix": Wrong(_raw(_CAGE.text, "asset.xyz")),
    "text as usdc": Wrong(_raw(_CAGE.text, "asset.usdc"), ANY),
    "deep brackets": Wrong(_raw(_text('def Scope "Root"\n{\n    custom int[] a = ' + "[" * 100000))),
    "deep dictionaries": Wrong(
        _raw(_text("", "    customData = " + "{ dictionary a = " * 20000 + "{}" + "}" * 20000 + "\n"))
    ),
    "5,000 nested prims": _nested(5000),
    "200,000 nested prims": _nested(200_000),
    "a number of 5,000 digits": _cage("0.5", "1" * 5000, NAMED),
    "a number of 5,000 digits in an array": _cage("(0, 0, 4)", f"(0, 0, {'1' * 5000})", NAMED),
    "a comma missing": _cage(", (1, -1, -1)", " (1, -1, -1)"),
    "a bracket missing": _cage("]", ""),
    "two prims of one name": _cage('"Loop"', '"Body"', ANY),
    "two attributes of one name": _cage(
        "uniform token subdivisionScheme", "point3f[] points = []\n        uniform token subdivisionScheme", ANY
    ),
    # Packages.
    "package of nothing": Wrong(_zip("")),
    "package of an image": Wrong(_zip(PIXELS, "a.png")),
    "package of packed text": Wrong(_zip(_CAGE.text, method=zipfile.ZIP_DEFLATED), ANY),
    "package of text": Wrong(_zip(_CAGE.text), ANY),
    "package with a way out": Wrong(_zip(_text(_ROOT_REFERS.format("../part.usda"))), NAMED),
    "package of itself": Wrong(_zip(_text(_ROOT_REFERS.format("../asset.usdz"))), NAMED),
    # Metadata.
    "metersPerUnit of text": _cage("metersPerUnit = 0.5", 'metersPerUnit = "0.5"'),
    **{f"upAxis {value}": _cage('upAxis = "Y"', f"upAxis = {value}") for value in ('"X"', '"y"', '""', '"Up"', "1")},
    **{
        line: _cage('upAxis = "Y"', f'upAxis = "Y"\n    {line}', ANY)
        for line in ("startTimeCode = nan", "timeCodesPerSecond = 0", "frobnicate = 3")
    },
    "startTimeCode of text": _cage('upAxis = "Y"', 'upAxis = "Y"\n    startTimeCode = "a"'),
    "defaultPrim that is not there": _cage('"Root"', '"Nowhere"', RIGHT),
    "defaultPrim that is no name": _cage('"Root"', '"a b/c"', ANY),
    # Sizes.
    "an unused far point": _cage("(0, 0, 5)]", "(0, 0, 5), (1e9, 1e9, 1e9)]", RIGHT),
    # Prims.
    **{
        f"{kind} of nothing": _prim(kind, NOTED)
        for kind in ("Frobnicator", "Volume", "NurbsPatch", "Mesh", "BasisCurves", "Points")
    },
    "NurbsCurves of nothing": _prim("NurbsCurves", NAMED),
    "PointInstancer of nothing": _prim("PointInstancer", RIGHT),
    "a mesh of nothing of a long name": _prim("Mesh", NOTED, "n" * 300),
    "a mesh of Greek letters, of nothing": _prim("Mesh", NOTED, "αβγ"),
    "an instanceable cycle": _prims(
        '    def "More" (instanceable = true; references = </Root>)\n    {\n    }', REFUSED, "/Root/More"
    ),
    "nothing to show": Wrong(_raw(_text('def Xform "Root"\n{\n}'))),
    "nested instancers": _prims(
        "\n".join(
            f'    def PointInstancer "I{number}"\n    {{\n        int[] protoIndices = {[0] * 200}\n'
            f"        point3f[] positions = {[(0, 0, 0)] * 200}\n        rel prototypes = </Root/{target}>\n    }}"
            for number, target in enumerate(("I1", "I2", "I3", "I4", "I5", "Body"))
        ),
        REFUSED,
        "/Root/I",
    ),
}
