"""All kinds of malformed input, by name."""

from __future__ import annotations

import sys
from pathlib import Path

from cases import Kind
from eval_lines import EVAL
from looks import LOOKS
from materialx import MATERIALX

from jobs import JOBS

sys.path.append(str(Path(__file__).parent.parent / "asset"))  # whose tests check arrays of assets
from usd_assets import USD_ASSETS

KINDS: dict[str, Kind] = {kind.name: kind for kind in (USD_ASSETS, JOBS, EVAL, MATERIALX, LOOKS)}
