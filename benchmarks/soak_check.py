"""Reads the sessions of a soak and accounts for every sample: ``python -m benchmarks.soak_check``.

One JSON object a line on standard input (``path``, ``first_sample``, ``first_frame``, or ``path`` and ``camera`` =
"GigE Vision" or "paced driver" for devices with numbers of their own), one a line on standard output
(``samples``, ``frames``, ``problems``). A sound session is deleted; the process ends with its standard input.
"""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import paced_camera, wire_camera
from benchmarks.counting_card import numbers
from benchmarks.counting_rig import SHAPE, counted_audio, counted_image
from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import info, open_session

CHECK_S = 1800.0
"""Longest that checking one session may take, s."""


class Checker:
    """The process that reads sessions."""

    def __init__(self) -> None:
        root = Path(__file__).resolve().parent.parent
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.soak_check"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=root,
        )
        self._answers: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, name="soak check", daemon=True).start()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def ask(self, **question: Any) -> None:
        """Begin to check a session."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(question) + "\n")
        self._process.stdin.flush()

    def answer(self) -> dict[str, Any]:
        """Outcome of the oldest question."""
        line = self._answers.get(timeout=CHECK_S)
        if not line:
            raise RuntimeError("the process that checks sessions has ended")
        found: dict[str, Any] = json.loads(line)
        return found

    def told(self) -> dict[str, Any] | None:
        """Outcome of the oldest question, None while it is being checked."""
        return None if self._answers.empty() else self.answer()

    def close(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(30)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(5)

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._answers.put(line)
        self._answers.put("")
        self._process.stdout.close()


def check(path: Path, first_sample: int, first_frame: int) -> dict[str, object]:
    """Account for every sample and pixel of a session whose numbers begin as told."""
    found: list[str] = list(info(path)["problems"])
    sample, number = first_sample, first_frame
    expected = np.empty(SHAPE, np.uint16)
    with open_session(path) as session:
        for index, row in enumerate(session.sweeps):
            samples = session.audio(index)
            if int(row["device_frame"]) != sample or not np.array_equal(samples, counted_audio(sample, len(samples))):
                found.append(f"audio record {index} does not hold the numbers from {sample}")
            sample = int(row["device_frame"]) + len(samples)
        for index, row in enumerate(session.frames):
            if int(row["frame_id"]) != number:
                found.append(f"frame {index} is number {row['frame_id']} where {number} was expected")
            number = int(row["frame_id"]) + 1
            if not np.array_equal(session.frame(index), counted_image(int(row["frame_id"]), expected)):
                found.append(f"frame {index} does not show its number")
    return {"samples": sample - first_sample, "frames": number - first_frame, "problems": found[:20]}


def check_wires(path: Path, camera: str) -> dict[str, object]:
    """Account for a session over the wires of either camera: numbers follow each other within records, and differ from
    the devices' own counts by constants."""
    pictures = wire_camera if camera == "GigE Vision" else paced_camera
    found: list[str] = list(info(path)["problems"])
    samples = 0
    offsets: set[int] = set()
    with open_session(path) as session:
        for index, row in enumerate(session.sweeps):
            counted = numbers(session.audio(index))
            offsets.add(int(counted[0]) - int(row["device_frame"]))
            if np.any(np.diff(counted) != 1) or len(offsets) > 1:
                found.append(f"audio record {index} has a gap")
            samples += len(counted)
        offsets = set()
        last, wraps = 0, 0
        for index, row in enumerate(session.frames):
            # Block ids of 16 bits go on with 1 after 65535: the number of the frame is what they count on.
            block_id = int(row["frame_id"])
            wraps, last = wraps + (block_id < last), block_id
            number = pictures.number_of(session.frame(index))
            offsets.add(-1 if number is None else (block_id + 0xFFFF * wraps - number) % pictures.CYCLE)
            if len(offsets) > 1 or number is None:
                found.append(f"frame {index} does not show its number")
        return {"samples": samples, "frames": len(session.frames), "problems": found[:20]}


def main() -> None:
    """Serve until standard input ends."""
    for line in sys.stdin:
        asked = json.loads(line)
        path = Path(asked["path"])
        try:
            wires = "camera" in asked
            told = (
                check_wires(path, asked["camera"])
                if wires
                else check(path, asked["first_sample"], asked["first_frame"])
            )
        except PolfuseError as error:
            told = {"samples": 0, "frames": 0, "problems": [str(error)]}
        told["file_bytes"] = path.stat().st_size if path.is_file() else 0
        if not told["problems"]:
            path.unlink()
        print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
