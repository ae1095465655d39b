"""192 kHz stereo and 782 x 582 Mono16 at 60 fps together: nothing is lost, and what taking them in costs.

The sound card is the simulated one over PulseAudio, in a process of its own. The camera is the simulated GigE Vision
camera, triggered by software, also in a process of its own: UDP packets on loopback, the GenTL producer, harvesters, in
the camera process that every camera driver gets. Where the producer is not built (``make gentl``), a paced driver
without a wire takes its place; the rows say which it was. Measured is the driver side: this process (audio
port, ring, records, frames out of shared memory) and the camera's.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from benchmarks.counting_card import numbers
from benchmarks.paced_camera import PacedCamera
from benchmarks.rows import Row
from benchmarks.wire_camera import CYCLE, number_of
from drivers.camera.genicam_setup import GenicamOptions
from drivers.camera.process import CameraProcess
from drivers.camera.producers import ARAVIS, aravis_producer
from drivers.radar.sound_port import SoundPort
from drivers.records import Frame

RATE_HZ = 192_000
FRAME_HZ = 60.0
RECORD_FRAMES = RATE_HZ // 2
CPU_LIMIT = 0.60
POLL_S = 0.002
LONG_S, QUICK_S = 60.0, 10.0
SHAPE = (582, 782)
ADDRESS = "127.0.0.9"
"""Of its own: the only port that a GigE camera can have may be in use on the others."""
EXPOSURE_S = 0.001
LINK_BITS_PER_S = 5e9
"""5GigE. A gigabit would carry the rate, but not leave the time for a trigger to follow each frame."""
PACKET_BYTES = 9000
"""Jumbo frames, as a camera of this rate has them on a network card of its own."""
WIRE, PACED = "GigE Vision over UDP, 5 Gbit/s, software trigger", "paced driver without a wire"


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
    camera: str = ""
    """Where the frames came from."""


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
        Row(
            "reliability.throughput.camera",
            tally.camera,
            None,
            video_ok,
            f"782 x 582 Mono16 at 60 fps ({tally.camera}), none lost",
            error=video,
        ),
        Row(
            "reliability.throughput.cpu",
            "",
            cpu / CPU_LIMIT,
            cpu < CPU_LIMIT,
            f"below {CPU_LIMIT:g} of one core ({tally.camera})",
        ),
    ]


def measure(seconds: float) -> Tally:
    """Take in audio and frames for so long."""
    wire = sys.platform.startswith("linux") and aravis_producer() is not None
    with _card() as card, _wire_camera() if wire else _camera() as camera:
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
            # The paced camera keeps its own time.
            trigger_s, is_right = (1 / FRAME_HZ, _pattern_check()) if wire else (0.0, _paced_is_right)
            tally = _take(radar, camera, seconds, trigger_s, is_right)
            tally.camera = WIRE if wire else PACED
            return tally
        finally:
            radar.close()


def _paced_is_right(frame: Frame) -> bool:
    """Whether a frame of the paced camera is the one that its number says."""
    return bool(frame.image[0, 0] == frame.frame_id % 65_536)


def _pattern_check() -> Callable[[Frame], bool]:
    """Whether a frame of the camera on the wire is the one that its number says; they differ by a constant."""
    offsets: set[int] = set()

    def is_right(frame: Frame) -> bool:
        number = number_of(frame.image)
        if number is None:
            return False
        offsets.add((frame.frame_id - number) % CYCLE)
        return len(offsets) == 1

    return is_right


def _take(
    radar: SoundPort, camera: CameraProcess, seconds: float, trigger_s: float, is_right: Callable[[Frame], bool]
) -> Tally:
    """Take in for so long, a frame at most every ``trigger_s``."""
    tally = Tally()
    offset: int | None = None
    assert camera.pid is not None
    start, cpu_s = time.monotonic(), time.process_time() + _cpu_s(camera.pid)
    radar.begin(RECORD_FRAMES)
    triggers, waiting = 0, False
    next_frame: int | None = None
    while (elapsed := time.monotonic() - start) < seconds:
        if not waiting and elapsed >= triggers * trigger_s:
            # One that is late because the frame before it was does not move those that follow.
            camera.trigger()
            triggers, waiting = triggers + 1, True
        frame = camera.poll()
        if frame is not None:
            waiting = False
            if next_frame is not None:
                tally.frames_lost += frame.frame_id - next_frame
            next_frame = frame.frame_id + 1
            tally.frames += 1
            tally.frames_wrong += int(not is_right(frame))
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
def _program(*words: str) -> Iterator[str]:
    """A program of the benchmarks that runs until its standard input ends; yields the line that it begins with."""
    root = Path(__file__).resolve().parent.parent
    command = [sys.executable, "-m", *words]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=root)
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield process.stdout.readline()
    finally:
        process.stdin.close()
        process.wait(timeout=20)
        process.stdout.close()


@contextmanager
def _card() -> Iterator[dict[str, object]]:
    with _program("benchmarks.counting_card", str(RATE_HZ)) as told:
        yield json.loads(told)


@contextmanager
def _wire_camera() -> Iterator[CameraProcess]:
    """The camera on the wire, triggered by software."""
    rows, columns = SHAPE
    with _program("benchmarks.wire_camera", ADDRESS, str(rows), str(columns), str(LINK_BITS_PER_S)) as told:
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
