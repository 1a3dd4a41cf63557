"""A render worker of the real protocol that starts at once: the standard library alone, and pixels by the digest.

Usage: quick_worker.py SECONDS, which a frame takes.
"""

import json
import os
import signal
import struct
import sys
import tempfile
import time
import zipfile


def npy(shape: tuple, value: float) -> bytes:
    """Return an array of one value as NumPy's format 1.0 has it."""
    count = 1
    for side in shape:
        count *= side
    head = repr({"descr": "<f4", "fortran_order": False, "shape": shape}).encode()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + struct.pack("<f", value) * count


def send(**message: object) -> None:
    os.write(1, (json.dumps(message) + "\n").encode())


def main() -> None:
    seconds = float(sys.argv[1])
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    send(type="ready", blender="4.5.0 quick")
    for line in sys.stdin:
        task = json.loads(line)
        digest, (width, height) = task["digest"], task["scene"]["resolution"]
        time.sleep(seconds)
        value = int(digest[:4], 16) / 65536.0
        arrays = {
            "a": ((height, width, 3), value),
            "b": ((height, width, 3), 0.5 * value),
            "alpha": ((height, width), 1.0),
        }
        try:
            handle, path = tempfile.mkstemp(suffix=".npz", dir=os.environ["TMPDIR"])  # else /tmp, once that is gone
            with os.fdopen(handle, "wb") as stream, zipfile.ZipFile(stream, "w") as archive:
                for name, (shape, filled) in arrays.items():
                    archive.writestr(f"{name}.npy", npy(shape, filled))
        except OSError as error:
            send(type="failed", digest=digest, message=str(error), unwritable=True)
            continue
        send(type="done", digest=digest, arrays=path, samples=8, seconds=seconds, relmse=0.01, memory=1 << 20)


main()
