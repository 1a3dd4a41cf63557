"""The small job and the fake worker are those of tests/batch."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "batch"))
