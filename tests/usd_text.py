"""Texts of small files for tests: jobs, and USD and MaterialX files with materials, images, variants and meshes."""

METRES = '#usda 1.0\n( upAxis = "Z"\n  metersPerUnit = 1 )\n'


JOB_KEYS = {
    "output": '"out"',
    "asset": '{ builtin = "plane" }',
    "ibl": '[{ name = "white", builtin = "white" }]',
    "turntable": '[{ kind = "element", frames = 2 }]',
    "render": "{ resolution = [8, 8] }",
}


def job_toml(look: str = "", **keys: str) -> str:
    """Return the text of a job with the keys `JOB_KEYS`, some of them replaced by `keys`.

    `look` has names and files of looks, like "gold = gold.usda, tin = tin.usda".
    """
    named = [pair.split(" = ") for pair in look.split(", ") if pair]
    looks = ", ".join(f'{{ name = "{name}", material = "{file}" }}' for name, file in named)
    keys = JOB_KEYS | ({"look": f"[{looks}]"} if looks else {}) | keys
    return "".join(f"{key} = {value}\n" for key, value in keys.items())


def shader(name: str, kind: str, *lines: str) -> str:
    """Return a shader prim with the ``info:id`` `kind` and further lines."""
    return "\n".join((f'def Shader "{name}"', "{", f'uniform token info:id = "{kind}"', *lines, "}\n"))


def material(name: str = "Paint", *inputs: str, scope: str = "", more: str = "") -> str:
    """Return a material of one Disney layer, with lines for its inputs.

    `scope` is the path of the prim above the material, and `more` has further lines of the material.
    """
    surface = f"token outputs:lookdev:surface.connect = <{scope}/{name}/Base.outputs:layer>"
    base = shader("Base", "LookdevDisney", *inputs, "token outputs:layer")
    return f'def Material "{name}"\n{{\n{surface}\n{base}{more}}}\n'


def textured(name: str = "Paint", *inputs: str, file: str = "map.png", st: str = "st", space: str = "raw") -> str:
    """Return a material that reads an image, by default for its base colour.

    `inputs` are lines for the inputs of its layer, `st` is the name of the UV set, `space` the colour space.
    """
    base_color = f"color3f inputs:baseColor.connect = </{name}/Map.outputs:rgb>"
    return material(name, *(inputs or (base_color,)), more=image(name, file, st, space))


def image(name: str, file: str = "map.png", st: str = "st", space: str = "raw") -> str:
    """Return the shaders Map and St, which read an image, for the material with a name."""
    texture = shader(
        "Map",
        "UsdUVTexture",
        f"asset inputs:file = @{file}@",
        f'token inputs:sourceColorSpace = "{space}"',
        'token inputs:wrapS = "repeat"',
        'token inputs:wrapT = "repeat"',
        f"float2 inputs:st.connect = </{name}/St.outputs:result>",
        "float outputs:r",
        "color3f outputs:rgb",
    )
    return texture + shader("St", "UsdPrimvarReader_float2", f'string inputs:varname = "{st}"', "float2 outputs:result")


def card(name: str, *lines: str) -> str:
    """Return a square mesh in the plane y = 0, with x and z from -1 to 1, and with further lines."""
    return "\n".join(
        (
            f'def Mesh "{name}"',
            "{",
            "int[] faceVertexCounts = [4]",
            "int[] faceVertexIndices = [0, 1, 2, 3]",
            "point3f[] points = [(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)]",
            *lines,
            "}\n",
        )
    )


def variant_set(name: str, **variants: str) -> str:
    """Return a variant set; `variants` has the lines of each variant by its name."""
    bodies = "".join(f'"{variant}" {{\n{lines}\n}}\n' for variant, lines in variants.items())
    return f'variantSet "{name}" = {{\n{bodies}}}\n'


def translate(x: float, y: float, z: float) -> str:
    """Return the lines that move a prim."""
    return f'double3 xformOp:translate = ({x}, {y}, {z})\nuniform token[] xformOpOrder = ["xformOp:translate"]\n'


def mtlx(image_file: str, space: str = "lin_rec709") -> str:
    """Return a MaterialX document with the material Paint, a standard surface whose colour is an image."""
    return f"""<?xml version="1.0"?>
<materialx version="1.38">
  <image name="color" type="color3">
    <input name="file" type="filename" value="{image_file}" colorspace="{space}"/>
  </image>
  <standard_surface name="shader" type="surfaceshader">
    <input name="base_color" type="color3" nodename="color"/>
  </standard_surface>
  <surfacematerial name="Paint" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="shader"/>
  </surfacematerial>
</materialx>
"""
