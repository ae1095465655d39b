"""A soak in real time over the wires: sound card and camera at full rate, through the writer into session files.

Driver side, queue and writer are those of a collect; a loop takes records and frames in as fast as they come, since
plans record and expose one after the other. Sessions follow each other; a checker reads, compares and deletes each.
"""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.counting_rig import rig
from benchmarks.full_rate import FRAME_HZ, RATE_HZ, SHAPE, counting_card, paced_camera, sound_port, wire_camera
from benchmarks.memory_watch import MemoryWatch
from benchmarks.soak_check import Checker
from drivers.camera.process import CameraProcess
from drivers.camera.producers import aravis_producer
from drivers.radar.sound_port import SoundPort
from drivers.records import Channel
from polfuse_lab.engine.recorder import WriterProcess
from polfuse_lab.records import Exposure, Record, Sweeps
from polfuse_lab.session import SessionConfig

RECORD_FRAMES = RATE_HZ // 2
POLL_S = 0.002
CLOSE_S = 120.0


@dataclass
class Passage:
    """What arrived, what went missing on the way, and how long the loop took to come round."""

    seconds: float = 0.0
    sessions: int = 0
    samples: int = 0
    samples_lost: int = 0
    frames: int = 0
    frames_lost: int = 0
    samples_checked: int = 0
    frames_checked: int = 0
    full: int = 0
    """How often the writer's queue was full."""
    longest_poll_s: float = 0.0
    longest_callback_s: float = 0.0
    camera: str = ""
    problems: list[str] = field(default_factory=list)

    @property
    def kept(self) -> bool:
        """Whether everything that the drivers delivered has been read back from the files as it was."""
        return self.samples == self.samples_checked and self.frames == self.frames_checked and not self.problems

    @property
    def sound(self) -> bool:
        """Whether, besides, the drivers lost nothing."""
        return self.kept and self.samples_lost == self.frames_lost == 0


class Files:
    """One session after another: the next one is begun, and the last one closed, beside the loop that records."""

    def __init__(self, folder: Path, watch: MemoryWatch, found: Passage) -> None:
        self._folder, self._watch, self._found = folder, watch, found
        self._checker = Checker()
        watch.watch("checker", self._checker.pid)
        self._closing: list[threading.Thread] = []
        self._answered = 0
        self._number = 0
        self._begin()
        self._take_next()

    def put(self, record: Record) -> None:
        """Give a record to the present session."""
        while not self._present.offer(record):
            self._found.full += 1
            time.sleep(POLL_S)

    def roll_over(self) -> None:
        """Go on in the next session."""
        while (told := self._checker.told()) is not None:
            self._take(told)
        self._close(self._present)
        self._take_next()

    def end(self) -> None:
        """Close everything and wait for the checks."""
        self._opening.join(CLOSE_S)
        self._next.kill()
        self._close(self._present)
        for thread in self._closing:
            thread.join(CLOSE_S)
        while self._answered < len(self._closing):
            self._take(self._checker.answer())
        self._checker.close()

    def _take(self, told: dict[str, Any]) -> None:
        self._answered += 1
        self._found.samples_checked += told["samples"]
        self._found.frames_checked += told["frames"]
        self._found.problems += told["problems"]

    def _begin(self) -> None:
        self._next = WriterProcess(self._folder / f"wires-{self._number:04d}.h5")
        config = SessionConfig(
            source="collect",
            waveform=rig().waveform,
            sample_rate_hz=RATE_HZ,
            audio_block_frames=RECORD_FRAMES,
            frame_shape=SHAPE,
        )
        self._opening = threading.Thread(target=self._next.open, args=(config,), name="next session")
        self._opening.start()

    def _take_next(self) -> None:
        self._opening.join(CLOSE_S)
        self._present = self._next
        self._watch.watch("writer", self._present.pid, self._number)
        self._number += 1
        self._found.sessions += 1
        self._begin()

    def _close(self, recorder: WriterProcess) -> None:
        def work() -> None:
            path = recorder.close("finished", "")
            self._checker.ask(path=str(path), camera=self._found.camera)

        thread = threading.Thread(target=work, name="last session")
        thread.start()
        self._closing.append(thread)


def soak(folder: Path, seconds: float, session_s: float, watch: MemoryWatch) -> Passage:
    """Record for so long, in sessions of ``session_s``."""
    found = Passage()
    wire = sys.platform.startswith("linux") and aravis_producer() is not None
    found.camera = "GigE Vision" if wire else "paced driver"
    with counting_card() as card, wire_camera() if wire else paced_camera() as camera:
        radar = sound_port(card)
        radar.open()
        files = Files(folder, watch, found)
        try:
            assert camera.pid is not None
            watch.watch("camera", camera.pid)
            _record(radar, camera, files, found, seconds, session_s, 1 / FRAME_HZ if wire else 0.0)
        finally:
            files.end()
            radar.close()
    return found


def _record(
    radar: SoundPort,
    camera: CameraProcess,
    files: Files,
    found: Passage,
    seconds: float,
    session_s: float,
    trigger_s: float,
) -> None:
    start = last = time.monotonic()
    rolled, triggers, waiting = start, 0, False
    next_frame: int | None = None
    radar.begin(RECORD_FRAMES)
    # Sessions with a problem are kept, so that one would fill the disk before the time is over.
    while (now := time.monotonic()) - start < seconds and not found.problems:
        found.longest_poll_s, last = max(found.longest_poll_s, now - last), now
        if not waiting and now - start >= triggers * trigger_s:
            camera.trigger()
            # Triggers that a busy computer could not send in time are not made up for.
            triggers = max(triggers + 1, int((now - start) / trigger_s) if trigger_s else 0)
            waiting = True
        frame = camera.poll()
        if frame is not None:
            waiting = False
            # Block ids of 16 bits go on with 1 after 65535.
            found.frames_lost += 0 if next_frame is None else (frame.frame_id - next_frame) % 0xFFFF
            next_frame = frame.frame_id + 1
            found.frames += 1
            files.put(Exposure(frame, 0.0))
        block = radar.poll()
        if block is not None:
            radar.begin(RECORD_FRAMES)
            found.samples += len(block.samples)
            files.put(Sweeps(block, Channel.HH, 0))
            if now - rolled > session_s:
                files.roll_over()
                rolled = now
        if frame is None and block is None:
            time.sleep(POLL_S)
    found.seconds = time.monotonic() - start
    found.samples_lost = radar.lost_frames
    found.longest_callback_s = radar.longest_callback_s
