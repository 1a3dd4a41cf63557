"""Assets whose prims, materials, UV sets and primvars have names that are long, foreign, or words of a language."""

import random
import unicodedata
from collections.abc import Callable
from pathlib import Path

from cases import SOUND, Case, Reading, Shown, planned_kind, reading_of
from pictures import job, table
from usd_pictures import material
from usd_sound import CUBE

from lookdev.asset.usd import read_usd
from lookdev.codegen.source import short_name
from lookdev.material.usd.bound import read_bound_looks
from lookdev.stage import Composition, compose

_PLAIN = ("Root", "Body", "Second", "Looks", "Paint", "Rubber", "more", "map", "wear", "rust", "tint")
_PRIMVARS = _PLAIN[6:]
_WORDS = """
    float int color normal point vector matrix string struct void return if else for while break continue output
    shader surface closure public emit true false and or not double long short unsigned const static inline main
    N Ng P I u v dPdu dPdv time dtime dPdtime Ci M_PI stdosl abs mix noise texture trace getattribute
    None True def class lambda import self name bpy position material_index sharp_face sharp_edge crease_vert id
    radius velocity custom_normal prototype UVMap Col Generated Object location rotation scale density instance_id
    Material Shader Mesh primvars st_0 uv_map primvar_wear handed shading_tangent lookup0 lookdev_uv result wo wi
    alpha seed light layer0 base pi x uv tangent tangent_sign undisplaced undeformed generated generated_transform
    motion_P motion_N particle curve_intercept curve_length curve_random point_random vertex_color Ng_ face_normal
    ptex_face_id ptex_uv flame heat temperature velocity_x pointiness random_per_island
    shadow_transparency UV undisplaced_N undisplaced_tangent
""".split()  # noqa: SIM905
"""Of OSL and C, of Python and Blender, of USD and our own code."""

_FOREIGN = ("größe", "漢字", "ναός", "Ñandú", "имя", "ß", "ſt", "Ⅷ", "ʹa", "हिन्दी", "한글", "K", "ﬁ")


_LAST = "abcdefghijk"
# Names by their number in an asset.
_FAMILIES: dict[str, Callable[[random.Random, int], str]] = {
    # They differ in their last character alone.
    "long": lambda rng, n: "n" * (rng.choice((55, 56, 62, 63, 64, 66, 67, 68, 127, 128, 199)) - 1) + _LAST[n],
    "foreign": lambda rng, n: _FOREIGN[(n + rng.randrange(3)) % len(_FOREIGN)] + _LAST[n],
    # Two each are written differently, in code points, and look alike.
    "composed": lambda rng, n: unicodedata.normalize("NFC" if n % 2 else "NFD", "éàü") + _LAST[n // 2],
    "long and foreign": lambda rng, n: "字" * rng.randrange(18, 70) + "ä" * n,
    # They differ by case alone.
    "cased": lambda rng, n: "".join(c.upper() if n >> place & 1 else c for place, c in enumerate("wear")),
    # Prims have no namespaces.
    "in namespaces": lambda rng, n: ("a:" if _PLAIN[n] in _PRIMVARS else "a_") * rng.randrange(1, 30) + f"b{n}",
    "underscores": lambda rng, n: "_" * (n + 1),
    "numbers": lambda rng, n: f"_{n}",
}
_PLAN = (
    *((f"family {name}", name) for name in _FAMILIES for _ in range(8)),
    *(("word", word) for word in _WORDS),
    *(("short names of others", str(number)) for number in range(4)),
)
_JOB = job(table(usd="asset.usda"))


def _text(names: tuple[str, ...]) -> str:
    root, body, second, looks, paint, rubber, more, uv, wear, rust, tint = names
    above = f"/{root}/{looks}"
    primvars = f"""
        texCoord2f[] primvars:{more} = [(0.75, 0.5)] (interpolation = "constant")
        texCoord2f[] primvars:{uv} = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0.5), (1, 0.5), (0.5, 1), (0, 0.25)] (
            interpolation = "vertex"
        )
        float[] primvars:{wear} = [0, 0.25, 0.5, 0.75, 1, 1, 0, 0.5] (interpolation = "vertex")
        float[] primvars:{rust} = [1, 0.5, 0, 0.25, 0.5, 0, 1, 1] (interpolation = "vertex")
        color3f[] primvars:{tint} = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1)] (
            interpolation = "uniform"
        )
        uniform token subdivisionScheme = "none"
"""
    first = material(paint, above, st=uv, wear=wear, rust=rust, tint=tint)
    other = material(rubber, above, wear=rust, tint=tint)
    bound = 'prepend apiSchemas = ["MaterialBindingAPI"]'
    return f"""#usda 1.0
( defaultPrim = "{root}" )
def Xform "{root}" {{
    def Mesh "{body}" ({bound}) {{{CUBE}{primvars}        rel material:binding = <{above}/{paint}>
    }}
    def Mesh "{second}" ({bound}) {{{CUBE}{primvars}        rel material:binding = <{above}/{rubber}>
        double3 xformOp:translate = (3, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    def Scope "{looks}" {{
{first}{other}    }}
}}
"""


def _read(file: Path, names: tuple[str, ...]) -> Reading:
    """Read an asset, with its plain names again."""
    composed = compose(Composition(file))
    asset = read_usd(composed)
    result: dict[str, object] = {}
    for number, mesh in enumerate(asset.meshes):
        values = mesh.uvs | mesh.primvars
        result |= {
            f"{number} {plain}": values[name].tobytes()
            for plain, name in zip(_PLAIN, names, strict=True)
            if plain in _PRIMVARS
        }
        result[f"{number} others"] = len(values)
    bound = read_bound_looks(composed, [slot.material for slot in asset.slots if slot.material])
    result["looks"] = [len(material.look.layers) for material in bound.values()]
    result["lost"] = [str(fault) for material in bound.values() for fault in material.losses]
    return Reading(result, asset.notes)


def _write(folder: Path, notes: str = "", names: tuple[str, ...] = _PLAIN) -> str:
    (folder / "asset.usda").write_text(_text(names), encoding="utf-8")
    return _JOB


_sound = reading_of(_write, lambda folder: _read(folder / "asset.usda", _PLAIN))


def make(rng: random.Random, planned: tuple[str, str], folder: Path) -> Case:
    """Write an asset with other names: some of them, or all."""
    sort, which = planned
    names = list(_PLAIN)
    changed = range(len(_PLAIN)) if rng.random() < 0.5 else rng.sample(range(len(_PLAIN)), 5)
    if sort.startswith("family"):
        for place in changed:
            names[place] = _FAMILIES[which](rng, place)
    elif sort == "word":
        # The word is the name of a UV set, or of a primvar; other words are those of the rest.
        first = _WORDS.index(which) - rng.randrange(6, len(_PLAIN))
        names = [_WORDS[(first + place) % len(_WORDS)] for place in range(len(_PLAIN))]
    else:
        # A name that is what a long one becomes in Blender.
        names[7:] = ["m" * 80, short_name("m" * 80), "w" * 80, short_name("w" * 80)]
    _write(folder, names=tuple(names))
    file, given = folder / "asset.usda", tuple(names)
    return Case(f"{sort} {which}", SOUND, lambda: _read(file, given), _sound, shown=Shown(_JOB, {"sound": _write}))


NAMES = planned_kind("names", _PLAN, make, rounds=2)
