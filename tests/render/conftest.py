"""The worker is tried on the small job and the fake worker of tests/batch."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "batch"))
