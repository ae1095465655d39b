"""192 kHz stereo and 782 x 582 Mono16 at 60 fps together: nothing is lost, and what taking them in costs.

The sound card is the simulated one over PulseAudio, in a process of its own. The camera is the simulated GigE Vision
camera, triggered by software, also in a process of its own: UDP packets on loopback, the GenTL producer, harvesters, in
the camera process that every camera driver gets. Where the producer is not built (``make gentl``), a paced driver
without a wire takes its place; the rows say which it was. Measured is the driver side: this process (audio
port, ring, records, frames out of shared memory) and the camera's.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.counting_card import numbers
from benchmarks.full_rate import FRAME_HZ, RATE_HZ, counting_card, cpu_seconds, paced_camera, sound_port, wire_camera
from benchmarks.rows import Row
from benchmarks.wire_camera import CYCLE, number_of
from drivers.camera.process import CameraProcess
from drivers.camera.producers import aravis_producer
from drivers.radar.sound_port import SoundPort
from drivers.records import Frame

RECORD_FRAMES = RATE_HZ // 2
CPU_LIMIT = 0.60
POLL_S = 0.002
LONG_S, QUICK_S = 60.0, 10.0
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
    with counting_card() as card, wire_camera() if wire else paced_camera() as camera:
        radar = sound_port(card)
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
    start, cpu_s = time.monotonic(), time.process_time() + cpu_seconds(camera.pid)
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
    tally.cpu_s = time.process_time() + cpu_seconds(camera.pid) - cpu_s
    tally.samples_lost = max(tally.samples_lost, radar.lost_frames)
    tally.longest_callback_s = radar.longest_callback_s
    return tally
