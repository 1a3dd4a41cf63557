"""Python imports this where `children` is on its path: programs that tests start record what they reach."""

import os
import sys
from pathlib import Path

if "LOOKDEV_REACH_OWNER" in os.environ:
    sys.path.append(str(Path(__file__).resolve().parents[1]))
    import recorder

    sys.path.pop()
    recorder.ChildRecorder(Path(os.environ[recorder.FOLDER]), os.environ[recorder.OWNER])
