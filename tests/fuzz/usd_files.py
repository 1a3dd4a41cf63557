"""What can be wrong with the files of a USD asset and how they are composed."""

# ruff: noqa: E501
from __future__ import annotations

import os
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from pxr import Sdf, UsdUtils
from usd_mutations import ANY, NAMED, NOTED, REFUSED
from usd_mutations import SOUND as RIGHT
from usd_sound import CUBE, PIXELS, SOUND, Sound

_CAGE = SOUND["cage"]
_HEAD = '#usda 1.0\n(\n    defaultPrim = "Root"\n    metersPerUnit = 0.5\n    upAxis = "Y"\n'
Write = Callable[[Path, random.Random], Path | None]


@dataclass(frozen=True)
class Wrong:
    """A sound asset, how its files are written wrongly, and what must become of it; the file's name is returned."""

    write: Write
    expected: frozenset[str] = REFUSED
    names: tuple[str, ...] = ("asset.",)
    sound: Sound = _CAGE
    right: Write | None = None
    """What writes the sound files where `sound` alone does not."""
    noted: Write | None = None
    """What writes files without what a note says is lost."""


def _text(body: str, more: str = "") -> str:
    return f"{_HEAD}{more})\n\n{body}\n"


def _part(folder: Path, suffix: str = ".usda", sound: Sound = _CAGE) -> Path:
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(sound.text)
    path = folder / f"part{suffix}"
    layer.Export(str(path))
    return path


def _root(body: str, more: str = "", *, suffix: str = ".usda") -> Write:
    """Return what writes a root layer beside a sound ``part``."""

    def write(folder: Path, rng: random.Random) -> None:
        _part(folder, suffix)
        (folder / "asset.usda").write_text(_text(body, more), encoding="utf-8")

    return write


def _arc(arc: str, kind: str = "references") -> Write:
    return _root(f'def "Root" ({kind} = {arc})\n{{\n}}')


def _beside(arc: str, kind: str = "references") -> Write:
    """Return what writes a root layer with a sound part and a broken one beside it."""
    return _root(
        f'def "Root" (references = @part.usda@</Root>)\n{{\n    def "More" ({kind} = {arc})\n    {{\n    }}\n}}'
    )


def _damaged(way: str, change: Callable[[bytes, random.Random], bytes]) -> Write:
    """Return what changes the bytes of the only file, or of a layer that the root references."""

    def write(folder: Path, rng: random.Random) -> Path | None:
        if way == "usdz":
            file = folder / "asset.usdz"
            UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(_part(folder, ".usdc"))), str(file))
        elif way.startswith("part"):
            file = _part(folder, way.removeprefix("part"))
            (folder / "asset.usda").write_text(_text(f'def "Root" (references = @{file.name}@</Root>)\n{{\n}}'))
        else:
            file = _part(folder, way).rename(folder / f"asset{way}")
        file.write_bytes(change(file.read_bytes(), rng))
        return file if not way.startswith("part") else None

    return write


def _truncated(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(1, len(data) * 9 // 10)]


def _scrambled(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 8, 64))):
        changed[rng.randrange(8, len(changed))] = rng.randrange(256)
    return bytes(changed)


def _noise(data: bytes, rng: random.Random) -> bytes:
    return data[:8] + rng.randbytes(len(data))


def _tail(data: bytes, rng: random.Random) -> bytes:
    return data + rng.randbytes(64)


def _cycle(folder: Path, rng: random.Random) -> None:
    (folder / "asset.usda").write_text(_text('def "Root" (references = @b.usda@</Root>)\n{\n}'))
    (folder / "b.usda").write_text(_text('def "Root" (references = @asset.usda@</Root>)\n{\n}'))


def _sublayer_cycle(folder: Path, rng: random.Random) -> None:
    (folder / "asset.usda").write_text(_text(_sound_body(), "    subLayers = [@b.usda@]\n"))
    (folder / "b.usda").write_text(_text("", "    subLayers = [@asset.usda@]\n"))


def _sound_body(sound: Sound = _CAGE) -> str:
    return sound.text.split(")\n\n", 1)[1]


def _raw(content: str | bytes, name: str = "asset.usda") -> Write:
    def write(folder: Path, rng: random.Random) -> Path:
        data = content if isinstance(content, bytes) else content.encode()
        (folder / name).write_bytes(data)
        return folder / name

    return write


def _made(make: Callable[[Path], object], name: str = "asset.usda") -> Write:
    def write(folder: Path, rng: random.Random) -> Path:
        make(folder / name)
        return folder / name

    return write


def _special(make: Callable[[Path], object]) -> Write:
    """Return what makes something that is no regular file where the root names a layer."""

    def write(folder: Path, rng: random.Random) -> None:
        make(folder / "odd.usda")
        _beside("@odd.usda@")(folder, rng)

    return write


def _zip(*members: tuple[str, bytes], method: int = zipfile.ZIP_STORED) -> Write:
    def write(folder: Path, rng: random.Random) -> Path:
        with zipfile.ZipFile(folder / "asset.usdz", "w", method) as archive:
            for name, data in members:
                archive.writestr(name, data)
        return folder / "asset.usdz"

    return write


def _metadata(old: str, new: str) -> Write:
    assert old in _CAGE.text
    return _raw(_CAGE.text.replace(old, new, 1))


def _prims(text: str) -> Write:
    """Return what appends prims to the sound root."""
    return _raw(_CAGE.text.rstrip()[:-1] + text + "\n}\n")


def _chain(count: int, arc: str) -> str:
    prims = [f'def "P{i}" ({arc} = </P{i + 1}>)\n{{\n}}' for i in range(count)]
    return "\n".join(prims)


def _clips(**changes: str) -> Write:
    """Return what writes value clips over a mesh, with some of their metadata changed."""
    fields = {
        "assetPaths": "asset[] assetPaths = [@clip1.usda@, @clip2.usda@]",
        "manifest": "asset manifestAssetPath = @manifest.usda@",
        "primPath": 'string primPath = "/Root"',
        "active": "double2[] active = [(0, 0), (2, 1)]",
        "times": "double2[] times = [(0, 0), (4, 4)]",
    } | changes
    lines = "\n".join(f"            {line}" for line in fields.values() if line)
    base = _text(
        f'def "Root" (\n    references = @part.usda@</Root>\n    clips = {{\n        dictionary default = {{\n{lines}\n'
        "        }\n    }\n)\n{\n}"
    )
    part = _text(f'def Xform "Root"\n{{\n    def Mesh "Body"\n    {{\n{CUBE}\n    }}\n}}')
    clip = _text(
        'over "Root"\n{\n    over "Body"\n    {\n        point3f[] points.timeSamples = { TIME: [(-1, -1, -1), '
        "(1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 2), (1, -1, 2), (1, 1, 2), (-1, 1, 2)] }\n    }\n}"
    )

    def write(folder: Path, rng: random.Random) -> None:
        (folder / "asset.usda").write_text(base)
        (folder / "part.usda").write_text(part)
        for number in (1, 2):
            (folder / f"clip{number}.usda").write_text(clip.replace("TIME", str(2 * number - 2)))
        (folder / "manifest.usda").write_text(
            _text('over "Root"\n{\n    over "Body"\n    {\n        point3f[] points\n    }\n}')
        )

    return write


def _clipped(expected: frozenset[str], *names: str, **changes: str) -> Wrong:
    return Wrong(_clips(**changes), expected, ("asset.", "/Root", *names), Sound("", (), time=3.0), _clips())


def _image(make: Callable[[Path], object]) -> Wrong:
    """Return an asset whose texture is made otherwise."""

    def write(folder: Path, rng: random.Random) -> None:
        (folder / "asset.usda").write_text(SOUND["materials"].text)
        make(folder / "color.png")

    return Wrong(write, NAMED, ("asset.usda", "color.png"), SOUND["materials"])


_HEADER = b"IHDR" + struct.pack(">II", 100_000, 100_000) + PIXELS[24:29]
_HUGE = PIXELS[:12] + _HEADER + struct.pack(">I", zlib.crc32(_HEADER)) + PIXELS[33:]
_MTLX = """<?xml version="1.0"?>
<materialx version="1.39">
  <standard_surface name="S" type="surfaceshader">
    <input name="base_color" type="color3" value="0.5, 0.25, 1"/>
    <input name="specular_roughness" type="float" value="0.5"/>
  </standard_surface>
  <surfacematerial name="M" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="S"/>
  </surfacematerial>
</materialx>
"""


def _document(content: str | bytes) -> Write:
    """Return what writes an asset that binds a material of a MaterialX document, and the document."""

    def write(folder: Path, rng: random.Random) -> None:
        body = (
            f'def Xform "Root"\n{{\n    def Mesh "Body" (prepend apiSchemas = ["MaterialBindingAPI"])\n    {{\n{CUBE}\n'
            "        rel material:binding = </Root/Looks/Materials/M>\n    }\n"
            '    def "Looks" (references = @look.mtlx@</MaterialX>)\n    {\n    }\n}'
        )
        (folder / "asset.usda").write_text(_text(body))
        if content:
            (folder / "look.mtlx").write_bytes(content if isinstance(content, bytes) else content.encode())

    return write


def _with_document(content: str | bytes, expected: frozenset[str] = REFUSED, *names: str) -> Wrong:
    return Wrong(_document(content), expected, names or ("look.mtlx",), Sound("", ()), _document(_MTLX))


def _over(text: str) -> Wrong:
    """Return an asset with a layer over it that overrides what is not there."""

    def write(folder: Path, rng: random.Random) -> None:
        (folder / "asset.usda").write_text(_CAGE.text)
        (folder / "over.usda").write_text(f"#usda 1.0\n{text}\n")

    return Wrong(write, NOTED, ("over.usda", "/Nowhere"), replace(_CAGE, layer="over.usda"), write)


_LONG = "n" * 300
_TRIANGLE = (
    '    def Mesh "More"\n    {{\n        point3f[] points = [(0, 0, 0), (1, 0, 0), {}]\n'
    "        int[] faceVertexCounts = [3]\n        int[] faceVertexIndices = [0, 1, 2]\n    }}"
)


def _nested(count: int) -> str:
    """Return the text of prims inside each other."""
    return "".join(f'def "P{i}"\n{{\n' for i in range(count)) + "}\n" * count


def _scaled(size: float) -> str:
    """Return the text of a cube of some half-width."""
    cube = re.sub(r"\b1\b(?=[,)])", f"{size:g}", CUBE.splitlines()[1])
    rest = "\n".join(CUBE.splitlines()[2:])
    return _text(f'def Xform "Root"\n{{\n    def Mesh "Body"\n    {{\n{cube}\n{rest}\n    }}\n}}')


FILES: dict[str, Wrong] = {
    # Arcs.
    "reference to no file": Wrong(_arc("@nowhere.usda@</Root>"), names=("asset.usda", "nowhere.usda")),
    "reference beside to no file": Wrong(_beside("@nowhere.usda@"), names=("asset.usda", "/Root/More", "nowhere.usda")),
    "reference to no prim": Wrong(_beside("@part.usda@</Nowhere>"), names=("asset.usda", "/Root/More", "Nowhere")),
    "reference to no prim of its own": Wrong(_beside("</Nowhere>"), names=("asset.usda", "/Root/More", "Nowhere")),
    "reference to itself": Wrong(_beside("</Root/More>"), names=("asset.usda", "/Root/More")),
    "reference to its parent": Wrong(_beside("</Root>"), names=("asset.usda", "/Root/More")),
    "references in a cycle": Wrong(_cycle, names=("asset.usda", "/Root")),
    "reference to a file without defaultPrim": Wrong(
        _special(lambda path: path.write_text('#usda 1.0\ndef Scope "A"\n{\n}')), names=("asset.usda", "odd.usda")
    ),
    "reference to a folder": Wrong(_special(Path.mkdir), names=("asset.usda", "odd.usda")),
    "reference to a pipe": Wrong(_special(os.mkfifo), names=("asset.usda", "odd.usda")),
    "reference to an empty file": Wrong(_special(Path.touch), names=("asset.usda", "odd.usda")),
    "reference to an image": Wrong(_special(lambda path: path.write_bytes(PIXELS)), names=("asset.usda", "odd.usda")),
    "reference to a device": Wrong(_beside("@/dev/zero@"), names=("asset.usda", "/dev/zero")),
    "reference to an unknown suffix": Wrong(_beside("@part.usdx@"), names=("asset.usda", "part.usdx")),
    "reference with an offset that is not finite": Wrong(_beside("@part.usda@</Root> (offset = nan)"), ANY),
    "reference with a scale of 0": Wrong(_beside("@part.usda@</Root> (scale = 0)"), ANY),
    "payload to no file": Wrong(_beside("@nowhere.usda@", "payload"), names=("asset.usda", "/Root/More", "nowhere")),
    "payload to itself": Wrong(_beside("</Root/More>", "payload"), names=("asset.usda", "/Root/More")),
    "sublayer to no file": Wrong(
        _root(_sound_body(), "    subLayers = [@nowhere.usda@]\n"), names=("asset.usda", "nowhere")
    ),
    "sublayers in a cycle": Wrong(_sublayer_cycle, names=("asset.usda",)),
    "sublayer of bad text": Wrong(
        _special(lambda path: path.write_text("#usda 1.0\ndef {")), names=("asset.usda", "odd.usda")
    ),
    "sublayer twice": Wrong(_root(_sound_body(), "    subLayers = [@part.usda@, @part.usda@]\n"), RIGHT | REFUSED),
    "inherits nothing": Wrong(
        _root(_sound_body().replace('def Xform "Root"', 'def Xform "Root" (inherits = </No>)')), RIGHT
    ),
    "inherits itself": Wrong(
        _root(_sound_body().replace('def Xform "Root"', 'def Xform "Root" (inherits = </Root>)')),
        names=("asset.usda", "/Root"),
    ),
    "inherits in a long chain": Wrong(_raw(_CAGE.text + _chain(500, "inherits")), RIGHT),
    "broken reference in another variant": Wrong(
        _root(
            'def "Root" (references = @part.usda@</Root>; variants = {string v = "a"}; prepend variantSets = "v")\n{\n'
            '    variantSet "v" = {\n        "a" {\n        }\n        "b" (references = @nowhere.usda@) {\n        }\n    }\n}'
        ),
        RIGHT,
    ),
    "no such variant": Wrong(
        _arc("@part.usda@</Root>"), names=("asset.usda", "v"), sound=replace(_CAGE, variants=(("v", "x"),))
    ),
    "authored variant that is not there": Wrong(
        _root(
            'def "Root" (references = @part.usda@</Root>; variants = {string v = "zz"}; prepend variantSets = "v")\n{\n'
            '    variantSet "v" = {\n        "a" {\n        }\n    }\n}'
        ),
        ANY,
    ),
    "no layer over it": Wrong(
        _arc("@part.usda@</Root>"), names=("nowhere.usda",), sound=replace(_CAGE, layer="nowhere.usda")
    ),
    "layer over it of bad text": Wrong(
        _special(lambda path: path.write_text("#usda 1.0\n(")),
        names=("odd.usda",),
        sound=replace(_CAGE, layer="odd.usda"),
    ),
    # Files.
    # Without a checksum, one changed number is another sound file.
    **{
        f"{what} {way}": Wrong(_damaged(way, change), ANY | {"silent"}, ("asset.",))
        for what, change in (("truncated", _truncated), ("scrambled", _scrambled), ("noise in", _noise))
        for way in (".usda", ".usdc", "usdz", "part.usda", "part.usdc")
    },
    **{f"bytes after {way}": Wrong(_damaged(way, _tail), ANY) for way in (".usda", ".usdc", "usdz")},
    "no file": Wrong(lambda folder, rng: folder / "asset.usda"),
    "empty file": Wrong(_raw("")),
    "empty usdc": Wrong(_raw("", "asset.usdc")),
    "empty usdz": Wrong(_raw("", "asset.usdz")),
    "a folder": Wrong(_made(Path.mkdir)),
    "a pipe": Wrong(_made(os.mkfifo)),
    "a pipe as usdc": Wrong(_made(os.mkfifo, "asset.usdc"), names=("asset.usdc",)),
    "a link to itself": Wrong(_made(lambda path: path.symlink_to(path))),
    "a device": Wrong(_made(lambda path: path.symlink_to("/dev/zero"))),
    "an image": Wrong(_raw(PIXELS, "asset.usda")),
    "an image as usdc": Wrong(_raw(PIXELS, "asset.usdc"), names=("asset.usdc",)),
    "UTF-16": Wrong(_raw(_CAGE.text.encode("utf-16"))),
    "Latin-1": Wrong(_raw(_CAGE.text.replace('"Loop"', '"L\xf6\xf6p"').encode("latin-1"))),
    "a NUL": Wrong(_raw(_CAGE.text.replace("Loop", "Lo\0p"))),
    "escapes in a string": Wrong(_raw(_CAGE.text.replace('"loop"', '"\x1b[2J\x1b]0;x\x07"'))),
    "an unknown version": Wrong(_raw(_CAGE.text.replace("1.0", "9.0", 1))),
    "an unknown suffix": Wrong(_raw(_CAGE.text, "asset.xyz")),
    "text as usdc": Wrong(_raw(_CAGE.text, "asset.usdc"), ANY),
    "deep brackets": Wrong(_raw(_text('def Scope "Root"\n{\n    custom int[] a = ' + "[" * 100000))),
    "deep dictionaries": Wrong(
        _raw(_text("", "    customData = " + "{ dictionary a = " * 20000 + "{}" + "}" * 20000 + "\n"))
    ),
    "5,000 nested prims": Wrong(_raw(_text(_nested(5000)))),
    "a number of 5,000 digits": Wrong(_raw(_CAGE.text.replace("0.5", "1" * 5000, 1)), NAMED),
    "a number of 5,000 digits in an array": Wrong(
        _raw(_CAGE.text.replace("(0, 0, 4)", f"(0, 0, {'1' * 5000})", 1)), NAMED
    ),
    "a comma missing": Wrong(_raw(_CAGE.text.replace(", (1, -1, -1)", " (1, -1, -1)", 1))),
    "a bracket missing": Wrong(_raw(_CAGE.text.replace("]", "", 1))),
    "two prims of one name": Wrong(_raw(_CAGE.text.replace('"Loop"', '"Body"')), ANY),
    "two attributes of one name": Wrong(
        _raw(
            _CAGE.text.replace(
                "uniform token subdivisionScheme", "point3f[] points = []\n        uniform token subdivisionScheme", 1
            )
        ),
        ANY,
    ),
    # Packages.
    "package of nothing": Wrong(_zip()),
    "package of an image": Wrong(_zip(("a.png", PIXELS))),
    "package of packed text": Wrong(_zip(("a.usda", _CAGE.text.encode()), method=zipfile.ZIP_DEFLATED), ANY),
    "package of text": Wrong(_zip(("a.usda", _CAGE.text.encode())), ANY),
    "package with a way out": Wrong(
        _zip(("a.usda", _text('def "Root" (references = @../part.usda@</Root>)\n{\n}').encode())), NAMED
    ),
    "package of itself": Wrong(
        _zip(("a.usda", _text('def "Root" (references = @../asset.usdz@</Root>)\n{\n}').encode())), NAMED
    ),
    # Textures.
    "texture of nothing": _image(Path.touch),
    "texture that is a folder": _image(Path.mkdir),
    "texture that is a pipe": _image(os.mkfifo),
    "texture that is not there": _image(lambda path: None),
    "texture of text": _image(lambda path: path.write_text("no image")),
    "texture cut off": _image(lambda path: path.write_bytes(PIXELS[:20])),
    "texture of 100,000 x 100,000": _image(lambda path: path.write_bytes(_HUGE)),
    # MaterialX documents.
    "document": _with_document(_MTLX, RIGHT),
    "document that is not there": _with_document(""),
    "document of nothing": _with_document(" "),
    "document cut off": _with_document(_MTLX[:200]),
    "document of noise": _with_document(PIXELS),
    "document in UTF-16": _with_document(_MTLX.encode("utf-16")),
    "document without the material": _with_document(
        _MTLX.replace('name="M"', 'name="N"'), NAMED, "asset.", "/Root/Looks/Materials/M"
    ),
    "document of an unknown node": _with_document(
        _MTLX.replace("standard_surface", "frobnicator"), NAMED, "asset.|look.mtlx", "S"
    ),
    "document with a number that is none": _with_document(
        _MTLX.replace('value="0.5"', 'value="nan"'), NAMED, "asset.|look.mtlx", "specular_roughness"
    ),
    "document with a value of another type": _with_document(
        _MTLX.replace('value="0.5"', 'value="word"'), NAMED, "asset.|look.mtlx", "specular_roughness"
    ),
    "document of a cycle": replace(
        _with_document(
            _MTLX.replace(
                '<input name="base_color" type="color3" value="0.5, 0.25, 1"/>',
                '<input name="base_color" type="color3" nodename="A"/>',
            ).replace(
                "  <surfacematerial",
                '  <add name="A" type="color3"><input name="in1" type="color3" nodename="A"/></add>\n  <surfacematerial',
            ),
            NAMED,
            "asset.|look.mtlx",
            "A",
        ),
        noted=_document(_MTLX.replace("0.5, 0.25, 1", "0.8, 0.8, 0.8")),
    ),
    # Layers over the asset.
    "layer over nothing": _over('over "Nowhere"\n{\n    double radius = 1\n}'),
    # Metadata.
    **{
        f"metersPerUnit {value}": Wrong(
            _metadata("metersPerUnit = 0.5", f"metersPerUnit = {value}"), expected, ("asset.", "metersPerUnit")
        )
        for value, expected in (
            ("0", REFUSED),
            ("-1", REFUSED),
            ("nan", REFUSED),
            ("inf", REFUSED),
            ("1e300", REFUSED),
            ("1e-300", REFUSED),
            ("1e12", REFUSED),
            ("1e-12", REFUSED),
        )
    },
    **{
        f"points of {size:g}": Wrong(_raw(_scaled(size)), names=("asset.", "/Root/Body", "radius"))
        for size in (1e-30, 1e-9, 1e-6, 1e10, 1e15)
    },
    "a point of 1e30": Wrong(_prims(_TRIANGLE.format("(1e30, 0, 0)")), names=("asset.", "/Root/More", "points")),
    "an unused far point": Wrong(
        _raw(_CAGE.text.replace("(0, 0, 5)]", "(0, 0, 5), (1e9, 1e9, 1e9)]")), RIGHT, ("asset.", "/Root/Loop")
    ),
    "a transform of zeros": Wrong(
        _prims(
            f'    def Mesh "More"\n    {{{CUBE}        matrix4d xformOp:transform = ((0, 0, 0, 0), (0, 0, 0, 0), '
            '(0, 0, 0, 0), (0, 0, 0, 0))\n        uniform token[] xformOpOrder = ["xformOp:transform"]\n    }'
        ),
        NAMED,
        ("asset.", "/Root/More"),
    ),
    "200,000 nested prims": Wrong(_raw(_text(_nested(200_000)))),
    "metersPerUnit of text": Wrong(_metadata("metersPerUnit = 0.5", 'metersPerUnit = "0.5"')),
    **{
        f"upAxis {value}": Wrong(_metadata('upAxis = "Y"', f"upAxis = {value}"))
        for value in ('"X"', '"y"', '""', '"Up"', "1")
    },
    **{
        f"startTimeCode {value}": Wrong(
            _metadata('upAxis = "Y"', f'upAxis = "Y"\n    startTimeCode = {value}'), expected
        )
        for value, expected in (("nan", ANY), ("inf", ANY), ("1e300", ANY), ('"a"', REFUSED))
    },
    "timeCodesPerSecond 0": Wrong(_metadata('upAxis = "Y"', 'upAxis = "Y"\n    timeCodesPerSecond = 0'), ANY),
    "defaultPrim that is not there": Wrong(_metadata('"Root"', '"Nowhere"'), RIGHT),
    "defaultPrim that is no name": Wrong(_metadata('"Root"', '"a b/c"'), ANY),
    "unknown metadata": Wrong(_metadata('upAxis = "Y"', 'upAxis = "Y"\n    frobnicate = 3'), ANY),
    # Prims.
    "a prim of an unknown type": Wrong(
        _prims('    def Frobnicator "More"\n    {\n    }'), NOTED, ("asset.", "/Root/More")
    ),
    "a volume": Wrong(_prims('    def Volume "More"\n    {\n    }'), NOTED, ("asset.", "/Root/More")),
    "a patch": Wrong(_prims('    def NurbsPatch "More"\n    {\n    }'), NOTED, ("asset.", "/Root/More")),
    "a mesh of nothing": Wrong(_prims('    def Mesh "More"\n    {\n    }'), NOTED, ("asset.", "/Root/More")),
    "curves of nothing": Wrong(_prims('    def BasisCurves "More"\n    {\n    }'), NOTED, ("asset.", "/Root/More")),
    "NURBS of nothing": Wrong(_prims('    def NurbsCurves "More"\n    {\n    }'), NAMED, ("asset.", "/Root/More")),
    "points of nothing": Wrong(_prims('    def Points "More"\n    {\n    }'), NOTED, ("asset.", "/Root/More")),
    "an instancer of nothing": Wrong(
        _prims('    def PointInstancer "More"\n    {\n    }'), RIGHT, ("asset.", "/Root/More")
    ),
    "a sound prim of a long name": Wrong(_prims(f'    def Scope "{_LONG}"\n    {{\n    }}'), RIGHT),
    "a mesh of nothing of a long name": Wrong(_prims(f'    def Mesh "{_LONG}"\n    {{\n    }}'), NOTED),
    "a scope of Greek letters": Wrong(_prims('    def Scope "αβγ"\n    {\n    }'), RIGHT),
    "a mesh of Greek letters, of nothing": Wrong(_prims('    def Mesh "αβγ"\n    {\n    }'), NOTED, ("αβγ",)),
    "an instanceable cycle": Wrong(
        _prims('    def "More" (instanceable = true; references = </Root>)\n    {\n    }'),
        names=("asset.", "/Root/More"),
    ),
    "nothing to show": Wrong(_raw(_text('def Xform "Root"\n{\n}'))),
    "nested instancers": Wrong(
        _prims(
            "\n".join(
                f'    def PointInstancer "I{i}"\n    {{\n        int[] protoIndices = [{", ".join(["0"] * 200)}]\n'
                f"        point3f[] positions = [{', '.join(['(0, 0, 0)'] * 200)}]\n"
                f"        rel prototypes = </Root/{f'I{i + 1}' if i < 5 else 'Body'}>\n    }}"
                for i in range(6)
            )
        ),
        names=("asset.", "/Root/I"),
    ),
    "instancers in a ring": Wrong(
        _prims(
            "\n".join(
                f'    def PointInstancer "I{i}"\n    {{\n        int[] protoIndices = [0]\n'
                f"        point3f[] positions = [(0, 0, 0)]\n        rel prototypes = </Root/I{(i + 1) % 3}>\n    }}"
                for i in range(3)
            )
        ),
        names=("asset.", "/Root/I"),
    ),
    # Value clips.
    "sound clips": _clipped(RIGHT),
    "clip that is not there": _clipped(
        NAMED, "nowhere.usda", assetPaths="asset[] assetPaths = [@clip1.usda@, @nowhere.usda@]"
    ),
    "manifest that is not there": _clipped(NAMED, "nowhere.usda", manifest="asset manifestAssetPath = @nowhere.usda@"),
    "clips without a manifest": _clipped(RIGHT | NAMED, manifest=""),
    "clips of no prim": _clipped(NAMED, primPath='string primPath = "/Nowhere"'),
    "clips of a bad path": _clipped(NAMED, primPath='string primPath = "no path!"'),
    "active clip that is not there": _clipped(NAMED, active="double2[] active = [(0, 7)]"),
    "clip times that are not finite": _clipped(NAMED, times="double2[] times = [(0, nan)]"),
    "clips of another type": _clipped(NAMED, active='string active = "a"'),
}
