"""Runs the simulated GigE Vision camera and a client of somebody else's beside it, shut off from the network.

Clients search for cameras by broadcast, so both live in a network namespace with nothing but a loopback interface.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NAME = "PolFuse-SimCam-PEER"
"""How the camera is called by clients."""

_CAMERA = """
import json, sys, time
from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.gige_camera import GigeCamera, Pattern, Settings
from hw_mocks.world import World

given = json.loads(sys.argv[1])
faults = FaultScript()
if given["drop"]:
    faults.start(FaultKind.DROP_PACKETS, amount=given["drop"])
settings = Settings(serial="PEER", frame_rate_hz=given["frame_rate_hz"], packet_size=given["packet_size"])
with GigeCamera(Pattern(582, 782), World(), settings=settings, faults=faults) as camera:
    started = time.process_time()
    print("ready", flush=True)
    sys.stdin.readline()
    camera.check()
    print(json.dumps({**camera.counts, "cpu seconds": time.process_time() - started}), flush=True)
"""


class PeerMissing(Exception):
    """Something that is not ours is not installed, or may not be used here; says what."""


@contextlib.contextmanager
def namespace() -> Iterator[list[str]]:
    """A network namespace with only a loopback interface; yields the words that run a command in it.

    Raises:
        PeerMissing: iproute2 is not installed, or namespaces may not be made.
    """
    ip = shutil.which("ip")
    if ip is None or not hasattr(os, "geteuid") or os.geteuid() != 0:
        raise PeerMissing("network namespaces need iproute2 and root")
    name = f"pfgige{os.getpid()}_{time.monotonic_ns() % 10**9}"
    made = subprocess.run([ip, "netns", "add", name], capture_output=True, text=True, timeout=20)
    if made.returncode:
        raise PeerMissing(f"network namespaces cannot be made here ({made.stderr.strip()})")
    try:
        subprocess.run([ip, "-n", name, "link", "set", "lo", "up"], check=True, timeout=20)
        yield [ip, "netns", "exec", name]
    finally:
        subprocess.run([ip, "netns", "del", name], check=False, timeout=20)


class Beside:
    """The camera in a process of its own, and clients beside it."""

    def __init__(self, process: subprocess.Popen[str], prefix: list[str]) -> None:
        self._process, self._prefix = process, prefix

    def run(self, *words: str, timeout_s: float = 60.0) -> str:
        """What a command says."""
        done = subprocess.run([*self._prefix, *words], capture_output=True, text=True, timeout=timeout_s)
        return done.stdout.replace("\r", "\n") + done.stderr

    def finish(self) -> dict[str, float]:
        """End the camera; its counts, and ``"cpu seconds"`` of its process since it was ready."""
        out, _ = self._process.communicate("\n", timeout=15)
        return dict(json.loads(out))


@contextlib.contextmanager
def camera_beside(*, drop: float = 0.0, frame_rate_hz: float = 50.0, packet_size: int = 1500) -> Iterator[Beside]:
    """A camera of 782 x 582 pixels, Mono16, at 127.0.0.1 of a namespace of its own.

    Args:
        drop: fraction of packets that get lost.
        frame_rate_hz: frames per second.
        packet_size: bytes of a stream packet.

    Raises:
        PeerMissing: namespaces cannot be made.
    """
    given = {"drop": drop, "frame_rate_hz": frame_rate_hz, "packet_size": packet_size}
    with namespace() as prefix:
        process = subprocess.Popen(
            [*prefix, sys.executable, "-c", _CAMERA, json.dumps(given)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        try:
            assert process.stdout is not None
            if process.stdout.readline() != "ready\n":
                raise RuntimeError("the simulated camera did not start")
            yield Beside(process, prefix)
        finally:
            process.kill()
            process.wait(timeout=10)
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()


def aravis(tool: str) -> str:
    """Path of a tool of Aravis 0.8. Raises PeerMissing."""
    path = shutil.which(f"arv-{tool}-0.8")
    if path is None:
        raise PeerMissing("needs Debian's aravis-tools and aravis-tools-cli")
    return path


def aravis_counters(beside: Beside, seconds: int, *more: str) -> dict[str, int]:
    """Let Aravis' camera test take frames; the counters that it tells at its end.

    Raises:
        PeerMissing: Aravis is not installed.
        RuntimeError: it could not use the camera; says what it said.
    """
    words = (aravis("camera-test"), "-n", NAME, "--no-packet-socket", "-a", "--duration", str(seconds), *more)
    text = beside.run(*words, timeout_s=seconds + 30)
    counters = {name: int(value) for name, value in re.findall(r"^(n_\w+)\s*=\s*(\d+)", text, re.MULTILINE)}
    if not counters:
        raise RuntimeError(f"Aravis could not use the simulated camera: {text.strip()}")
    return counters
