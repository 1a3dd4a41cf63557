"""A small library of presets."""

from __future__ import annotations

from pathlib import Path

PRESET = """#usda 1.0
(
    defaultPrim = "{prim}"
)

def Shader "{prim}" (
    {doc}
    customData = {{
        string category = "{category}"
    }}
)
{{
    uniform token info:id = "{model}"
    {inputs}
    token outputs:layer
}}
"""


def write_preset(
    file: Path, inputs: str = "", model: str = "LookdevDisney", category: str = "metal", doc: str = ""
) -> None:
    """Write a preset whose prim is called as the file is, capitalised."""
    given = f'doc = """{doc}"""' if doc else ""
    file.write_text(
        PRESET.format(prim=file.stem.capitalize(), inputs=inputs, model=model, category=category, doc=given)
    )


def write_library(folder: Path) -> Path:
    """Write gold and rubber, both Disney's, wood and lacquer, both Pixar's."""
    folder.mkdir()
    write_preset(folder / "gold.usda", "color3f inputs:baseColor = (1, 0.75, 0.25)\nfloat inputs:metallic = 1")
    write_preset(folder / "rubber.usda", "color3f inputs:baseColor = (0, 0.25, 0.75)", category="rubber")
    wood = "color3f inputs:surfaceColor = (0.5, 0.25, 0.125)"
    write_preset(folder / "wood.usda", wood, "LookdevPixar", "wood")
    lacquer = "color3f inputs:surfaceColor = (1, 0.5, 0.5)\nfloat inputs:clear = 1\nfloat inputs:roughness = 0.125"
    write_preset(folder / "lacquer.usda", lacquer, "LookdevPixar", "wood")
    return folder
