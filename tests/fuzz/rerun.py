"""Run one case again, here: ``python tests/fuzz/rerun.py "USD assets" SEED NUMBER [FOLDER]``.

The files of the case are left in FOLDER, by default a new one; a traceback is the whole one.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from cases import judged, made
from kinds import KINDS

if __name__ == "__main__":
    name, seed, number, *folder = sys.argv[1:]
    place = Path(*folder) if folder else Path(tempfile.mkdtemp())
    place.mkdir(parents=True, exist_ok=True)
    case = made(KINDS[name], int(seed), int(number), place)
    sys.stdout.write(f"{case.title}\n{place}: {', '.join(each.name for each in place.iterdir())}\n")
    sys.stdout.write(f"expected: {' or '.join(sorted(case.expected))}, naming {case.error_names}\n")
    sys.stdout.flush()
    outcome = judged(case)
    sys.stdout.write(f"{outcome.outcome}{'' if outcome.right else ', which is wrong'}\n{outcome.text}\n")
