"""Run one case again, here: ``python tests/fuzz/rerun.py "USD assets" SEED NUMBER [FOLDER]``.

The files of the case are left in FOLDER, by default a new one; a traceback is the whole one.
"""

import sys
import tempfile
from pathlib import Path

from cases import judge, make_case
from kinds import KINDS

if __name__ == "__main__":
    name, seed, number, *folder = sys.argv[1:]
    target = Path(*folder) if folder else Path(tempfile.mkdtemp())
    target.mkdir(parents=True, exist_ok=True)
    case = make_case(KINDS[name], int(seed), int(number), target)
    sys.stdout.write(f"{case.title}\n{target}: {', '.join(file.name for file in target.iterdir())}\n")
    sys.stdout.write(f"expected: {' or '.join(sorted(case.expected))}, naming {case.error_names}\n")
    sys.stdout.flush()
    outcome = judge(case)
    sys.stdout.write(f"{outcome.outcome}{'' if outcome.right else ', which is wrong'}\n{outcome.text}\n")
