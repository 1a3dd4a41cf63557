"""The process in which a file is examined: a request on stdin, a report as the last line of stdout."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from lookdev.lifetime import end_with_parent
from lookdev.material.validate import bound_process
from lookdev.material.validate.examine import examine

if __name__ == "__main__":
    end_with_parent()
    request = json.loads(sys.stdin.read())
    file = Path(request["file"])
    bound_process(file)
    report = examine(file, request["prim"], request["variants"])
    sys.stdout.write("\n" + json.dumps(report.data()))
    sys.stdout.flush()
    os._exit(0)  # USD, damaged by a file, must not crash at exit
