"""Variant sets as text."""

from look_files import expand


def over(name: str, body: str) -> str:
    return f'over "{name}" {{\n{expand(body)}\n}}\n'


def variants(name: str, **bodies: str) -> str:
    """Return a variant set."""
    return f'variantSet "{name}" = {{\n' + "".join(f'"{key}" {{\n{body}\n}}\n' for key, body in bodies.items()) + "}\n"


def selecting(**selections: str) -> str:
    """Return the metadata of a prim that has variant sets, with the selected variant of each."""
    names = ", ".join(f'"{name}"' for name in selections)
    chosen = "; ".join(f'string {name} = "{variant}"' for name, variant in selections.items())
    return f"(\nprepend variantSets = [{names}]\nvariants = {{ {chosen} }}\n)"
