"""Mutation testing: plants small faults, drawn at random, in the package, and counts those that the tests find.

    python tests/mutation draw --seed 1      # draw a new list of mutants, tests/mutation/mutants.jsonl, without results
    python tests/mutation redraw --seed 2    # replace the mutants whose text is no longer in the code
    python tests/mutation follow REVISION    # rename in mutants what the code has renamed since a revision
    python tests/mutation reach              # record which functions each test reaches; Python 3.12 or later
    python tests/mutation check              # run all tests in a copy without a fault: none may fail
    python tests/mutation run [ROOM ...]     # test mutants without a result by the default tier; continues after Ctrl-C
    python tests/mutation run --within 60    # the same, with a minute of tests for each mutant; no result if none fails
    python tests/mutation run --survivors    # test the survivors again, after tests were added
    python tests/mutation run --proof        # test the survivors of the default tier by the tier `proof`
    python tests/mutation show [ROOM ...]    # print the survivors
    python tests/mutation report             # write the rates into docs/testing.md

A mutant is one fault in one function. A room is one or several packages below `lookdev`. If no test can find a mutant,
the reason is its `equivalent` in the list, written by hand.
"""

import argparse
import math
import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))

from mutant import LIST, ROOT, Mutant, locate, read_mutants, read_sources, write_mutants
from recorder import FOLDER
from testing_page import write_part

DATA = ROOT / ".mutation"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    draw = commands.add_parser("draw", help="draw mutants")
    draw.add_argument("--seed", type=int, default=1)
    redraw = commands.add_parser("redraw", help="replace mutants that are no longer in the code")
    redraw.add_argument("--seed", type=int, required=True)
    follow = commands.add_parser("follow", help="take over new names")
    follow.add_argument("revision", help="of git, at which the list was of the code")
    reach = commands.add_parser("reach", help="record what each test reaches")
    reach.add_argument("arguments", nargs="*", help="arguments of pytest, after --; default: -n 2")
    run = commands.add_parser("run", help="run tests against mutants")
    run.add_argument("rooms", nargs="*")
    run.add_argument("--jobs", type=int, default=2)
    run.add_argument("--limit", type=int, default=None, help="so many mutants")
    run.add_argument("--within", type=float, default=math.inf, metavar="SECONDS", help="of tests")
    which = run.add_mutually_exclusive_group()
    which.add_argument("--survivors", action="store_true")
    which.add_argument("--proof", action="store_true")
    show = commands.add_parser("show", help="print survivors")
    show.add_argument("rooms", nargs="*")
    commands.add_parser("check", help="run the tests without a fault")
    commands.add_parser("report", help="write docs/testing.md")
    options = vars(parser.parse_args())
    command = options.pop("command")
    functions = {"draw": draw_list, "redraw": redraw_lost, "follow": follow_names, "reach": record_reach}
    functions |= {"check": check_tests, "run": run_list, "show": show_survivors, "report": write_report}
    functions[command](**options)


def draw_list(seed: int) -> None:
    """Draw a new list of mutants."""
    from draw import draw_mutants

    mutants = draw_mutants(seed)
    write_mutants(mutants)
    print(f"{LIST.relative_to(ROOT)}: {len(mutants)} mutants")


def redraw_lost(seed: int) -> None:
    """Draw new mutants in place of those whose text is no longer in the code."""
    from draw import draw_mutants

    mutants, lost = locate(read_mutants(), read_sources())
    drawn = draw_mutants(seed, Counter(mutant.room for mutant in lost), mutants)
    rooms = list(dict.fromkeys(mutant.room for mutant in [*mutants, *lost]))
    write_mutants(sorted([*mutants, *drawn], key=lambda mutant: rooms.index(mutant.room)))
    print(f"{LIST.relative_to(ROOT)}: {len(drawn)} mutants in place of {len(lost)}")


def follow_names(revision: str) -> None:
    """Write the mutants with the names that the code has now; `revision` has the code with their present names."""
    from renames import follow

    mutants = read_mutants()
    order = {mutant.name: number for number, mutant in enumerate(mutants)}
    present, lost = follow(mutants, read_sources(), revision)
    rooms = list(dict.fromkeys(mutant.room for mutant in mutants))
    write_mutants(sorted([*present, *lost], key=lambda mutant: rooms.index(mutant.room)))
    renamed = sum(mutant.name not in order for mutant in present)
    print(f"{LIST.relative_to(ROOT)}: {renamed} mutants by new names, {len(lost)} lost")


def record_reach(arguments: list[str]) -> None:
    """Run the tests with the plugin `reach`, which records the functions that each test reaches."""
    folder = DATA / "reach"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    here = Path(__file__).parent
    paths = os.pathsep.join((str(ROOT), str(here / "children"), str(here)))
    environment = os.environ | {"PYTHONPATH": paths, FOLDER: str(folder)}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "reach", *(arguments or ["-n", "2"])]
    sys.exit(subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode)


def check_tests() -> None:
    """Run all tests in a copy without a mutant, and print those that fail."""
    from run import Reached, failing_without_a_fault

    failing = failing_without_a_fault(Reached(DATA / "reach"))
    print(*(failing or ["none fails"]), sep="\n")
    sys.exit(1 if failing else 0)


def run_list(rooms: list[str], jobs: int, limit: int | None, within: float, survivors: bool, proof: bool) -> None:
    """Test the mutants that the options select, and write the list after each result."""
    from run import Reached, run_mutants

    mutants, lost = locate(read_mutants(), read_sources())
    for mutant in lost:
        print(f"no longer in the code: {mutant}", file=sys.stderr)
    tier = "proof" if proof else "default"

    def is_due(mutant: Mutant) -> bool:
        if mutant.equivalent or (rooms and mutant.room not in rooms):
            return False
        if proof:
            return mutant.tier == "default" and not mutant.killed_by
        return not mutant.killed_by if survivors else not mutant.tier

    due = [mutant for mutant in mutants if is_due(mutant)][:limit]
    results = {mutant.name: mutant for mutant in mutants}
    for count, mutant in enumerate(run_mutants(due, Reached(DATA / "reach"), tier, jobs, within), 1):
        results[mutant.name] = mutant
        write_mutants([*results.values(), *lost])
        result = mutant.killed_by or f"{'survives' if mutant.tier == tier else 'not found yet'}: {mutant}"
        print(f"{count}/{len(due)} {mutant.room} {result}", flush=True)


def survivors_of(rooms: list[str]) -> list[Mutant]:
    """Return the mutants of rooms, or of all rooms, that no test has found although a test could."""
    return [
        mutant
        for mutant in read_mutants()
        if mutant.tier and not mutant.killed_by and not mutant.equivalent and (not rooms or mutant.room in rooms)
    ]


def show_survivors(rooms: list[str]) -> None:
    for mutant in survivors_of(rooms):
        print(mutant)


def write_report() -> None:
    """Write the table of rates, with a row for each room, into docs/testing.md."""
    table = "| room | drawn | equivalent | found by the default tier | with `proof` |\n|---|---|---|---|---|"
    mutants = read_mutants()
    for room, drawn in Counter(mutant.room for mutant in mutants).items():
        tried = [mutant for mutant in mutants if mutant.room == room and (mutant.tier or mutant.equivalent)]
        real = [mutant for mutant in tried if not mutant.equivalent]
        found = [mutant.tier for mutant in real if mutant.killed_by]
        rates = [f"{100 * count / len(real):.1f} %" if real else "" for count in (found.count("default"), len(found))]
        part = f"{drawn}" if len(tried) == drawn else f"{drawn}, {len(tried)} tried"
        table += f"\n| {room} | {part} | {len(tried) - len(real)} | {rates[0]} | {rates[1]} |"
    write_part("mutants", f"{table}\n")


if __name__ == "__main__":
    main()
