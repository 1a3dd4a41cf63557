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
from damaged_files import DAMAGED
from images import IMAGES
from usd_assets import USD_ASSETS

_ALL = (USD_ASSETS, JOBS, EVAL, MATERIALX, LOOKS, *IMAGES, *DAMAGED)
KINDS: dict[str, Kind] = {kind.name: kind for kind in _ALL}
