"""All kinds of malformed input, by name."""

import sys
from pathlib import Path

from cases import Kind
from eval_lines import EVAL
from job_cases import JOBS
from look_cases import LOOKS
from materialx_cases import MATERIALX
from name_cases import NAMES
from rig_cases import RIGS

sys.path.append(str(Path(__file__).parent.parent / "asset"))  # whose tests check arrays of assets
from damaged_files import DAMAGED
from image_cases import IMAGES
from usd_assets import USD_ASSETS

_ALL = (USD_ASSETS, NAMES, JOBS, EVAL, MATERIALX, LOOKS, RIGS, *IMAGES, *DAMAGED)
KINDS: dict[str, Kind] = {kind.name: kind for kind in _ALL}
