"""Edits of assigned materials in the text of a job: everything else stays as it is."""

import difflib
import random
import tomllib
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("tomlkit", reason="the page's packages are not installed: pip install 'lookdev[studio]'")

from lookdev.errors import LookdevError
from lookdev.job.edit import AssignedMaterial, assign_material, assign_to_rest, unassign

PARTS = (Path(__file__).parents[2] / "jobs" / "parts.toml").read_text()
GOLD = AssignedMaterial("gold.usda", variants={"wear": "new"})

INLINE = """# inline
look = [ { name = "a", material = "m.usda" }, # the first
  { name = "b", assign = [ { prims = ["/A", "/B"], material = "n.usda" } ] } ]
output = "out"
"""
ARRAY = """output = "o"   # where

[[look]]
name = "a"
assign = [
    { prims = ["/A"], material = "a.usda" },  # of a
    { prims = ["/B", "/C"], material = "b.usda", variants = { x = "y" } },
]
# before b
[[look]]
name = "b"
layer = '''
[[look]]
''' # no header
# tail"""
NESTED = """[[look]]
name = "a"

[[look.assign]]
prims = [
  "/A", # one
  "/B",
]
material = "a.usda"
[look.assign.variants]
x = "y"

# the second
[[look.assign]]
prims = ["/C"]
material = "c.usda"
[render]
samples = 4
"""


def assigns(text: str, look: int) -> Any:
    return tomllib.loads(text)["look"][look].get("assign", [])


def changed(before: str, after: str) -> list[str]:
    """Return the lines that are removed and added."""
    lines = difflib.ndiff(before.splitlines(), after.splitlines())
    return sorted(entry for entry in lines if entry[0] in "+-" and entry[2:].strip())


def test_a_new_assign_stands_before_the_one_that_covers_the_part() -> None:
    after = assign_material(PARTS, 2, ["/Car/Body/Windows"], GOLD, 0)
    assert [entry["prims"] for entry in assigns(after, 2)] == [
        ["/Car/Body/Windows"],
        ["/Car.collection:trim", "/Car/Wheels/Front*/Tire"],
        ["/Car/Body"],
    ]
    assert changed(PARTS, after) == [
        "+ [[look.assign]]",
        '+ material = "gold.usda"',
        '+ prims = ["/Car.collection:trim", "/Car/Wheels/Front*/Tire"]',
        '+ prims = ["/Car/Body/Windows"]',
        '+ variants = { wear = "new" }',
        '- prims = ["/Car.collection:trim", "/Car/Body/Windows", "/Car/Wheels/Front*/Tire"]',
    ]


def test_the_same_prims_take_another_material_in_their_place() -> None:
    after = assign_material(PARTS, 2, ["/Car/Body"], AssignedMaterial("gold.usda"), 1)
    removed = ['- material = "../materials/car_paint.usda"', '- variants = { wear = "dusty" }']
    assert changed(PARTS, after) == ['+ material = "gold.usda"', *removed]


@pytest.mark.parametrize("look", [0, 1])
def test_the_first_assign_of_a_look_follows_its_keys(look: int) -> None:
    after = assign_material(PARTS, look, ["/Car/Body"], GOLD)
    before, at = PARTS.splitlines(), after.splitlines().index("[[look.assign]]")
    assert after.splitlines()[at - 2] == before[at - 2]
    assert assigns(after, look) == [{"prims": ["/Car/Body"], **GOLD.keys}]
    assert unassign(after, look, ["/Car/Body"]) == PARTS


def test_the_whole_look_takes_a_material() -> None:
    after = assign_to_rest(PARTS, 2, GOLD)
    assert changed(PARTS, after) == ['+ material = "gold.usda"', '+ variants = { wear = "new" }']
    removed = ['- material = "gold.usda"', '- variants = { wear = "new" }']
    tin = assign_to_rest(after, 2, AssignedMaterial("tin.usda"))
    assert changed(after, tin) == ['+ material = "tin.usda"', *removed]


def test_looks_and_assigns_that_are_inline_are_edited_in_place() -> None:
    after = assign_to_rest(INLINE, 0, GOLD)
    assert tomllib.loads(after)["look"][0] == {"name": "a", **GOLD.keys}
    assert "# the first" in after
    three = INLINE.replace('"n.usda" } ]', '"n.usda" }, { prims = ["/C"], material = "o.usda" }, { prims = ["/D"] } ]')
    left = [{"prims": ["/C"], "material": "o.usda"}]
    assert assigns(unassign(three, 1, ["/A", "/B", "/D"]), 1) == left


@pytest.mark.parametrize("text", [PARTS, INLINE, ARRAY, NESTED, PARTS.replace("\n", "\r\n")])
@pytest.mark.parametrize("seed", range(8))
def test_edits_make_the_intended_data_and_retain_every_comment(text: str, seed: int) -> None:
    """Each edit checks its own data; comments, and every other key, are compared here."""
    rng = random.Random(seed)
    edited, looks = text, len(tomllib.loads(text)["look"])
    for _ in range(6):
        look = rng.randrange(looks)
        tables = assigns(edited, look)
        assigned = [prim for entry in tables for prim in entry["prims"]]
        if assigned and rng.random() < 0.3:
            edited = unassign(edited, look, [rng.choice(assigned)])
        else:
            prims = [rng.choice([*assigned, "/New/Part", "/Other"])]
            covering = rng.choice([None, *range(len(tables))])
            edited = assign_material(
                edited, look, prims, rng.choice([GOLD, AssignedMaterial("tin.usda", "/Tin")]), covering
            )
            assert sum(prims[0] in entry["prims"] for entry in assigns(edited, look)) == 1
    removable = ("of a", "one", "the rest of the body: the first that fits counts")  # in an assign that can go
    for comment in (line.partition("#")[2].strip() for line in text.splitlines() if "#" in line):
        assert comment in edited or comment in removable
    before, after = tomllib.loads(text), tomllib.loads(edited)
    for look in (*before["look"], *after["look"]):
        look.pop("assign", None)
    assert before == after
    assert edited.count("\n") == edited.count("\r\n") if "\r\n" in text else "\r" not in edited


def test_tables_without_keys_and_tables_of_others_stay() -> None:
    first = '[[look.assign]]\nprims = ["/A"]\nmaterial = "a.usda"\n[look.assign.variants]\n'
    second = '[[look.assign]]\nprims = ["/B"]\nmaterial = "b.usda"\n'
    look, render = '[[look]]\nname = "a"\n', "[render]\nsamples = 4\n"
    assert unassign(look + first + second, 0, ["/A"]) == look + second
    assert (
        assign_material(look + render + first, 0, ["/B"], AssignedMaterial("b.usda"))
        == f"{look}{render}{first}\n{second}"
    )


def test_characters_are_written_as_they_are() -> None:
    assert 'material = "größe 🎨.usda"' in assign_material(PARTS, 0, ["/Car/Body"], AssignedMaterial("größe 🎨.usda"))


def test_a_layout_that_an_edit_breaks_is_refused() -> None:
    text = NESTED.replace('prims = ["/C"]', 'prims = ["/C"]\nlists = [\n["a"]\n]')
    with pytest.raises(LookdevError, match=r"the job's \[\[look\]\] has a layout that cannot be edited here"):
        assign_material(text, 0, ["/C"], GOLD, 1)


@pytest.mark.parametrize("text", ["look = 3", "", '[look]\nname = "a"'])
def test_a_job_without_a_list_of_looks_is_refused(text: str) -> None:
    with pytest.raises(LookdevError, match="look"):
        assign_material(text, 0, ["/A"], GOLD)
