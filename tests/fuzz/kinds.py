"""All kinds of malformed input, by name."""

import sys
from pathlib import Path

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "asset")]  # whose helpers the cases use
from cases import Kind
from damaged_files import DAMAGED
from eval_lines import EVAL
from image_cases import IMAGES
from job_cases import JOBS
from look_cases import LOOKS
from materialx_cases import MATERIALX
from name_cases import NAMES
from rig_cases import RIGS
from usd_assets import USD_ASSETS

_ALL = (USD_ASSETS, NAMES, JOBS, EVAL, MATERIALX, LOOKS, RIGS, *IMAGES, *DAMAGED)
KINDS: dict[str, Kind] = {kind.name: kind for kind in _ALL}
