"""Records which functions of the package run, by `sys.monitoring` of Python 3.12, which costs next to nothing."""

import json
import os
import sys
from pathlib import Path

PACKAGE = str(Path(__file__).resolve().parents[2]) + "/"
# Environment variables: the folder of the records, and the test or fixture that runs.
FOLDER, OWNER = "LOOKDEV_REACH", "LOOKDEV_REACH_OWNER"
TOOL = 4  # a tool id of sys.monitoring that no other tool has reserved
MONITORING = getattr(sys, "monitoring", None)


class Recorder:
    """The functions of the package that were reached since `switch` was last called."""

    def __init__(self) -> None:
        self.reached: set[str] = set()
        MONITORING.use_tool_id(TOOL, "reach")
        MONITORING.register_callback(TOOL, MONITORING.events.PY_START, self._start)
        MONITORING.set_events(TOOL, MONITORING.events.PY_START)

    def _start(self, code, offset: int) -> object:
        """Record the function that starts to run; it is not monitored again until the next `switch`."""
        if code.co_filename.startswith(PACKAGE) and "/tests/" not in code.co_filename:
            name = code.co_qualname.partition(".<locals>")[0]
            self.record(f"{code.co_filename.removeprefix(PACKAGE)}:{name}")
        return MONITORING.DISABLE

    def record(self, function: str) -> None:
        self.reached.add(function)

    def switch(self, reached: set[str]) -> set[str]:
        """Record into the set `reached` from now on; return the set that was used until now."""
        before, self.reached = self.reached, reached
        MONITORING.restart_events()
        return before


class ChildRecorder(Recorder):
    """Records functions in a program that a test started: a line for each, at once, because it may be killed."""

    def __init__(self, folder: Path, owner: str) -> None:
        self._file = (folder / f"child-{os.getpid()}.jsonl").open("a", buffering=1)
        self._owner = owner
        super().__init__()

    def record(self, function: str) -> None:
        self._file.write(json.dumps({"owner": self._owner, "reached": [function]}) + "\n")
