"""Write a synthetic measurement of a model: ``python -m lookdev.brdf.measured FILE MODEL [PARAMETERS]``.

An example of the arguments is ``plastic.binary disney '{"roughness": 0.3}'``. The file is a MERL binary, or the
anisotropic data of Ngan et al. if its name ends in ``.dat``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from lookdev.brdf.measured.synthetic import write_synthetic
from lookdev.brdf.models import complete_parameters, model_named

if __name__ == "__main__":
    name, model, *arguments = sys.argv[1:]
    parameters = complete_parameters(model, json.loads(arguments[0]) if arguments else {})
    write_synthetic(Path(name), model_named(model).bsdf(parameters))
