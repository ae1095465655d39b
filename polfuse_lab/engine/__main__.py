"""The engine's process: owns the devices, the scheduler and the live view; its children: writer, camera, guard, live.

Started by a client (:mod:`polfuse_lab.engine.link`) with the engine's private directory as its argument.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import traceback
from pathlib import Path

import msgspec

from polfuse_lab.engine import protocol
from polfuse_lab.engine.directory import REQUEST, remove


def main(directory: Path) -> None:
    """Carry out the request in ``directory``."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    request = msgspec.msgpack.decode((directory / REQUEST).read_bytes(), type=protocol.Request)
    (directory / REQUEST).unlink()
    match request.mode:
        case "collect":
            from polfuse_lab.engine.runs import run_collect

            run_collect(directory, request)
        case "replay":
            from polfuse_lab.engine.runs import run_replay

            run_replay(directory, request)
        case "bench":
            from polfuse_lab.bench.engine import run_bench

            run_bench(directory, request)


if __name__ == "__main__":
    private = Path(sys.argv[1])
    # A crash in native code (sound, camera, HDF5) leaves its stack in the engine's log, which the client quotes.
    faulthandler.enable()
    code = 1
    try:
        main(private)
        code = 0
        remove(private)
    except BaseException:
        # To the log, which the client quotes; it or the guard removes the directory then.
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        # A driver that hangs in native code must not keep the engine from ending.
        os._exit(code)
