"""A render worker for tests that speaks the real protocol, but does not render, and has faults that a test chooses.

Usage: fake_worker.py FOLDER. FOLDER/behaviour.json maps the name of a frame's first file to a list of behaviours, one
for each try to render the frame; the last behaviour holds for all further tries. Other frames succeed. The worker
writes the name of every requested frame to FOLDER/requests.txt, and its process id to FOLDER/pids.txt when it starts,
and to FOLDER/hangs.txt when it hangs.
"""

import json
import math
import os
import queue
import signal
import struct
import subprocess
import sys
import threading
import time
import zipfile
from pathlib import Path

folder = Path(sys.argv[1])
requests = folder / "requests.txt"


def send(**message: object) -> None:
    write(json.dumps(message) + "\n")


def write(text: str) -> None:
    sys.stdout.write(text)
    sys.stdout.flush()


def behaviour(name: str) -> str:
    """Return the behaviour for this try to render the frame with a file name."""
    file = folder / "behaviour.json"
    plan = json.loads(file.read_text()) if file.exists() else {}
    tries = requests.read_text().split().count(name)  # with this try
    behaviours = plan.get(name, ["ok"])
    return behaviours[min(tries, len(behaviours)) - 1]


def result(task: dict, how: str) -> None:
    """Send a frame of constant values; `how` is "ok", or a fault of its arrays or of their file."""
    digest = task["digest"]
    width, height = task["scene"]["resolution"]
    frame = (height, width)
    arrays = {"a": npy(0.25, *frame, 3), "b": npy(0.75, *frame, 3), "alpha": npy(0.5, *frame)}
    if passes := task["scene"]["sampling"]["passes"]:
        from lookdev.rendering.passes import channels_of_passes

        for name, channels in channels_of_passes(passes, task["scene"]["light_groups"]).items():
            arrays[f"pass {name}"] = npy(0.5, *frame, len(channels))
    if how == "shape":
        arrays["b"] = npy(0.75, height - 1, width, 3)
    elif how == "empty":
        arrays["alpha"] = npy(0.0, *frame)
    elif how == "nan":
        arrays["a"] = npy(math.nan, *frame, 3)
    elif how == "lack":
        del arrays["alpha"]
    path = Path(os.environ["TMPDIR"], f"{os.getpid()}-{time.monotonic_ns()}.npz")
    with zipfile.ZipFile(path, "w") as file:
        for name, content in arrays.items():
            file.writestr(f"{name}.npy", content)
    if how == "truncated":
        os.truncate(path, 100)
    for samples in (4, 8):
        send(type="progress", digest=digest, samples=samples, of=8, relmse=None if samples == 4 else 0.01)
    send(type="done", digest=digest, arrays=str(path), samples=8, seconds=0.125, relmse=0.01, memory=1 << 20)


def npy(value: float, *shape: int) -> bytes:
    """Return the bytes of an .npy file (format 1.0) with an array of one value.

    NumPy is not used, because to import it takes longer than everything else here.
    """
    header = repr({"descr": "<f4", "fortran_order": False, "shape": shape}).ljust(117) + "\n"
    magic = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header))
    return magic + header.encode() + struct.pack("<f", value) * math.prod(shape)


def act(task: dict, how: str) -> None:
    """Answer a task with the behaviour `how`."""
    digest = task["digest"]
    match how:
        case "die":
            os.kill(os.getpid(), signal.SIGKILL)
        case "exit":
            sys.stderr.write("the last line of the fake\n")
            sys.stderr.flush()
            os._exit(3)
        case "garbage":
            write("Fra:1 Mem:12M | Rendering\n")
        case "flood":
            write("x" * (1 << 21))
        case "half":
            write('{"type": "done", "dig')
            os._exit(0)
        case "ready":
            send(type="ready", blender="0.0")
        case "hang":
            (folder / "hangs.txt").write_text(str(os.getpid()))
            time.sleep(60)
        case "child":
            child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
            (folder / "child.txt").write_text(str(child.pid))
            time.sleep(60)
        case "failed":
            send(type="failed", digest=digest, message="no such attribute 'st2'")
        case "full":
            send(type="failed", digest=digest, message="/out: No space left on device", unwritable=True)
        case "other":
            send(type="failed", digest="0" * 64, message="of another frame")
        case "missing":
            send(type="done", digest=digest, arrays="/nowhere.npz", samples=8, seconds=0.1, relmse=0.01, memory=1 << 20)
        case "slow":
            time.sleep(0.2)
            result(task, "ok")
        case _:
            result(task, how)


def main() -> None:
    """Answer tasks from standard input; end as soon as the input ends, even during an answer."""
    lines: queue.Queue[str] = queue.Queue()

    def read() -> None:
        for line in sys.stdin:
            lines.put(line)
        os._exit(0)  # the parent has ended

    threading.Thread(target=read, daemon=True).start()
    with (folder / "pids.txt").open("a") as pids:
        pids.write(f"{os.getpid()}\n")
    send(type="ready", blender="4.5.0 fake")
    while True:
        task = json.loads(lines.get())
        name = Path(task["files"][0]).name if "files" in task else "scene"
        with requests.open("a") as log:
            log.write(f"{name}\n")
        if name != "scene":
            act(task, behaviour(name))


main()
