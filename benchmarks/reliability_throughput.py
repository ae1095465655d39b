"""192 kHz stereo and 782 x 582 Mono16 at 60 fps together: nothing is lost, and what taking them in costs.

The sound card is the simulated one over PulseAudio, in a process of its own; the camera is a paced one in the camera
process that every camera driver gets. Measured is the driver side: this process (audio port, ring, records, frames out
of shared memory) and the camera's.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from benchmarks.counting_card import numbers
from benchmarks.paced_camera import PacedCamera
from benchmarks.rows import Row
from drivers.camera.process import CameraProcess
from drivers.radar.sound_port import SoundPort

RATE_HZ = 192_000
FRAME_HZ = 60.0
RECORD_FRAMES = RATE_HZ // 2
CPU_LIMIT = 0.60
POLL_S = 0.004
LONG_S, QUICK_S = 60.0, 10.0


@dataclass
class Tally:
    """What arrived, what is missing, and the processors' time that it took."""

    seconds: float = 0.0
    cpu_s: float = 0.0
    samples: int = 0
    samples_lost: int = 0
    samples_wrong: int = 0
    frames: int = 0
    frames_lost: int = 0
    frames_wrong: int = 0
    longest_callback_s: float = 0.0


def run(quick: bool) -> list[Row]:
    """60 s, or 10 s when quick."""
    tally = measure(QUICK_S if quick else LONG_S)
    cpu = tally.cpu_s / tally.seconds
    audio = f"{tally.samples_lost} lost, {tally.samples_wrong} wrong of {tally.samples} frames of audio"
    video = f"{tally.frames_lost} lost, {tally.frames_wrong} wrong of {tally.frames} frames"
    audio_ok = tally.samples_lost == tally.samples_wrong == 0 and tally.samples > 0.8 * tally.seconds * RATE_HZ
    video_ok = tally.frames_lost == tally.frames_wrong == 0 and tally.frames > 0.97 * tally.seconds * FRAME_HZ
    return [
        Row("reliability.throughput.audio", "", None, audio_ok, "192 kHz stereo, none lost", error=audio),
        Row("reliability.throughput.camera", "", None, video_ok, "782 x 582 Mono16 at 60 fps, none lost", error=video),
        Row("reliability.throughput.cpu", "", cpu / CPU_LIMIT, cpu < CPU_LIMIT, f"below {CPU_LIMIT:g} of one core"),
    ]


def measure(seconds: float) -> Tally:
    """Take in audio and frames for so long."""
    with _card() as card, _camera() as camera:
        options = SoundPort.Options(
            device=str(card["device"]),
            environment=card["environment"],  # type: ignore[arg-type]
            sample_rate_hz=RATE_HZ,
            block_frames=RATE_HZ // 100,
            guard_s=0.03,
        )
        radar = SoundPort(options)
        radar.open()
        try:
            return _take(radar, camera, seconds)
        finally:
            radar.close()


def _take(radar: SoundPort, camera: CameraProcess, seconds: float) -> Tally:
    tally = Tally()
    offset: int | None = None
    assert camera.pid is not None
    start, cpu_s = time.monotonic(), time.process_time() + _cpu_s(camera.pid)
    radar.begin(RECORD_FRAMES)
    camera.trigger()
    next_frame: int | None = None
    while (elapsed := time.monotonic() - start) < seconds:
        frame = camera.poll()
        if frame is not None:
            camera.trigger()
            if next_frame is not None:
                tally.frames_lost += frame.frame_id - next_frame
            next_frame = frame.frame_id + 1
            tally.frames += 1
            tally.frames_wrong += int(frame.image[0, 0] != frame.frame_id % 65_536)
        block = radar.poll()
        if block is not None:
            radar.begin(RECORD_FRAMES)
            found = numbers(block.samples)
            tally.samples += len(found)
            tally.samples_lost += block.lost_frames
            # Numbers and the port's own count differ by a constant, over the whole run.
            offset = int(found[0]) - block.first_frame if offset is None else offset
            tally.samples_wrong += int((found[1:] - found[:-1] != 1).sum())
            tally.samples_wrong += int(found[0] - block.first_frame != offset)
        if frame is None and block is None:
            time.sleep(POLL_S)
    tally.seconds = elapsed
    tally.cpu_s = time.process_time() + _cpu_s(camera.pid) - cpu_s
    tally.samples_lost = max(tally.samples_lost, radar.lost_frames)
    tally.longest_callback_s = radar.longest_callback_s
    return tally


def _cpu_s(pid: int) -> float:
    """Processor time of another process so far, s (proc(5), fields utime and stime)."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _card() -> Iterator[dict[str, object]]:
    command = [sys.executable, "-m", "benchmarks.counting_card", str(RATE_HZ)]
    root = Path(__file__).resolve().parent.parent
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=root)
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield json.loads(process.stdout.readline())
    finally:
        process.stdin.close()
        process.wait(timeout=20)
        process.stdout.close()


@contextmanager
def _camera() -> Iterator[CameraProcess]:
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
