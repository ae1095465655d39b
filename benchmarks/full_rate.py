"""Devices at full rate, 192 kHz stereo and 782 x 582 Mono16 at 60 fps, simulated in processes of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.paced_camera import PacedCamera
from drivers.camera.genicam_setup import GenicamOptions
from drivers.camera.process import CameraProcess
from drivers.camera.producers import ARAVIS
from drivers.radar.sound_port import SoundPort

RATE_HZ = 192_000
FRAME_HZ = 60.0
SHAPE = (582, 782)
ADDRESS = "127.0.0.9"
"""Of its own: the only port that a GigE camera can have may be in use on the others."""
EXPOSURE_S = 0.001
LINK_BITS_PER_S = 5e9
"""5GigE. A gigabit would carry the rate, but not leave the time for a trigger to follow each frame."""
PACKET_BYTES = 9000
"""Jumbo frames, as a camera of this rate has them on a network card of its own."""


def sound_port(card: dict[str, object]) -> SoundPort:
    """The radar's audio port on :func:`counting_card`, not yet opened."""
    return SoundPort(
        SoundPort.Options(
            device=str(card["device"]),
            environment=card["environment"],  # type: ignore[arg-type]
            sample_rate_hz=RATE_HZ,
            block_frames=RATE_HZ // 100,
            guard_s=0.03,
        )
    )


def cpu_seconds(pid: int) -> float:
    """Processor time of another process so far, s (proc(5), fields utime and stime)."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def program(*words: str) -> Iterator[str]:
    """A program of the benchmarks that runs until its standard input ends; yields its first line.

    It has a session of its own, so that a device in software takes its processor from nobody's share (autogroups).
    """
    root = Path(__file__).resolve().parent.parent
    command = [sys.executable, "-m", *words]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=root, start_new_session=True
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield process.stdout.readline()
    finally:
        process.stdin.close()
        process.wait(timeout=20)
        process.stdout.close()


@contextmanager
def counting_card() -> Iterator[dict[str, object]]:
    """A sound card over PulseAudio whose samples count; yields its ``device`` and ``environment``."""
    with program("benchmarks.counting_card", str(RATE_HZ)) as told:
        yield json.loads(told)


@contextmanager
def wire_camera() -> Iterator[CameraProcess]:
    """The camera on the wire, triggered by software."""
    rows, columns = SHAPE
    with program("benchmarks.wire_camera", ADDRESS, str(rows), str(columns), str(LINK_BITS_PER_S)) as told:
        options = GenicamOptions(
            cti=ARAVIS,
            addresses=(told.strip(),),
            pixel_format="Mono16",
            exposure_s=EXPOSURE_S,
            packet_size_bytes=PACKET_BYTES,
        )
        camera = CameraProcess("harvesters", options)
        try:
            camera.open()
            yield camera
        finally:
            camera.close()


@contextmanager
def paced_camera() -> Iterator[CameraProcess]:
    """The paced camera in the camera process, offered as a plug-in by a distribution made for the occasion."""
    root = str(Path(__file__).resolve().parent.parent)
    with tempfile.TemporaryDirectory(prefix="polfuse-plugin-") as folder:
        info = Path(folder) / "polfuse_paced_camera-1.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: polfuse-paced-camera\nVersion: 1\n")
        (info / "entry_points.txt").write_text("[polfuse_lab.camera]\npaced = benchmarks.paced_camera:PacedCamera\n")
        paths = [path for path in (folder, root) if path not in sys.path]
        sys.path[:0] = paths
        camera = CameraProcess("paced", PacedCamera.Options(rate_hz=FRAME_HZ))
        try:
            camera.open()
            yield camera
        finally:
            camera.close()
            for path in paths:
                sys.path.remove(path)
