"""The engine's guard: a small process that makes switches and trolley safe when the engine dies without a goodbye.

The engine holds the other end of the guard's standard input. As long as it lives, the guard only waits. When the pipe
closes after a goodbye, the guard ends; when it closes without one (the engine was killed, or crashed), the guard opens
the switches and the trolley by the same drivers and options, brings them to their safe state and closes them again.
Whatever else the engine held (camera, sound card) is released by its end itself. Last, the guard removes the engine's
private directory, once a client has had the time to read the log in it.
"""

from __future__ import annotations

import contextlib
import inspect
import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers import registry
from drivers.errors import DeviceError, DeviceLost
from polfuse_lab.engine.children import SIGNALS, start_child
from polfuse_lab.engine.directory import remove
from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import Rig, driver_options, parse_model

KINDS = ("switches", "trolley")
LIMIT_S = 10.0
"""Longest that the guard works on devices after the engine's end, s."""
RETRY_S = 2.0
"""How long a port that is still in use is tried again: the system takes a dead process's ports back one by one."""
CLEAN_UP_S = 3.0
"""From the engine's end until its directory is removed: clients look every few tenths of a second."""
_GOODBYE = b"goodbye\n"


class Guard:
    """The engine's end of its guard.

    Args:
        rig_toml: text of the rig file.
        rig_path: where it came from, for messages.
        directory: the engine's private directory, removed when the engine did not do it itself; None: nothing is.
    """

    def __init__(self, rig_toml: str, rig_path: str, directory: Path | None = None) -> None:
        self._process = start_child("polfuse_lab.engine.guard", answers=False)
        told = {"rig_toml": rig_toml, "rig_path": rig_path, "directory": None if directory is None else str(directory)}
        self._say(json.dumps(told).encode() + b"\n")

    @property
    def pid(self) -> int:
        """Process id of the guard."""
        return self._process.pid

    def dismiss(self) -> None:
        """Tell the guard that all devices are safe and closed; it ends. Idempotent; never raises."""
        self._say(_GOODBYE)
        stream = self._process.stdin
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            if stream is not None:
                stream.close()
            self._process.wait(2)

    def _say(self, words: bytes) -> None:
        # A guard that has died is no reason to stop a measurement.
        with contextlib.suppress(OSError, ValueError):
            assert self._process.stdin is not None
            self._process.stdin.write(words)
            self._process.stdin.flush()


@dataclass(frozen=True)
class Secured:
    """What became of one device."""

    kind: str
    driver: str
    trouble: str | None
    """Why it could not be made safe, None when it was."""
    seconds: float

    def __str__(self) -> str:
        what = "was made safe" if self.trouble is None else f"could not be made safe: {self.trouble}"
        return f"guard: {self.kind} ({self.driver}) {what} ({self.seconds:.2f} s)"


def secure(rig: Rig, rig_path: Path, limit_s: float = LIMIT_S) -> list[Secured]:
    """Open the switches and the trolley of a rig, make them safe and close them, all at once; devices by hand are left.

    Args:
        rig: the rig.
        rig_path: its file, for messages.
        limit_s: longest time to wait for a device, s.

    Returns:
        What became of each device, in the order in which they were done.
    """
    results: list[Secured] = []
    names: dict[str, str] = {}
    threads: dict[str, threading.Thread] = {}
    started_s = time.monotonic()

    def work(kind: str, driver: str) -> None:
        try:
            device = _make(rig, kind, rig_path)
            trouble = None if device is None else _make_safe(device)
        except (DeviceError, PolfuseError) as error:
            trouble = str(error)
        except Exception as error:
            trouble = f"{type(error).__name__}: {error}"
        results.append(Secured(kind, driver, trouble, time.monotonic() - started_s))

    for kind in KINDS:
        section = rig.section(kind)
        if section is not None:
            names[kind] = section.driver
            threads[kind] = threading.Thread(
                target=work, args=(kind, section.driver), name=f"guard {kind}", daemon=True
            )
            threads[kind].start()
    for thread in threads.values():
        thread.join(max(started_s + limit_s - time.monotonic(), 0.0))
    done = {result.kind for result in results}
    late = [
        Secured(kind, names[kind], f"no answer within {limit_s:g} s", limit_s) for kind in threads if kind not in done
    ]
    return [*results, *late]


def _make(rig: Rig, kind: str, rig_path: Path) -> Any:
    """The driver of a kind, not opened; None where a person is the device."""
    section = rig.section(kind)
    assert section is not None
    driver = registry.driver_class(kind, section.driver)
    options = driver_options(rig, kind, rig_path)
    return None if "operator" in inspect.signature(driver).parameters else driver(options)


def _make_safe(device: Any) -> str | None:
    """Open, make safe, close; the trouble in words, None when there was none."""
    give_up_s = time.monotonic() + RETRY_S
    while True:
        try:
            device.open()
            break
        except DeviceLost as error:
            if time.monotonic() > give_up_s:
                return str(error)
            time.sleep(0.05)
    try:
        device.make_safe()
    finally:
        device.close()
    return None


def main() -> None:
    """Wait for the engine's end and do what is left to do."""
    for number in SIGNALS:
        # The engine decides when it is over; the guard's only cue is the pipe.
        signal.signal(number, signal.SIG_IGN)
    told = json.loads(sys.stdin.buffer.readline())
    path = Path(told["rig_path"])
    rig = parse_model(told["rig_toml"], Rig, path)
    for kind in KINDS:
        # Imported now, so that nothing is slow (or missing) when it matters.
        with contextlib.suppress(Exception):
            _make(rig, kind, path)
    if sys.stdin.buffer.read() == _GOODBYE:
        return
    died_s = time.monotonic()
    for result in secure(rig, path):
        with contextlib.suppress(OSError):
            print(result, file=sys.stderr, flush=True)
    if told["directory"] is not None:
        time.sleep(max(died_s + CLEAN_UP_S - time.monotonic(), 0.0))
        remove(Path(told["directory"]))


if __name__ == "__main__":
    try:
        main()
    finally:
        # A driver that hangs must not keep the guard.
        os._exit(0)
