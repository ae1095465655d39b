"""The window on a real collect at full rate, all on one computer: nothing is lost, whatever is done to the window.

The engine records 192 kHz stereo from the simulated sound card over PulseAudio, and 782 x 582 Mono16 from the simulated
GigE Vision camera (UDP, the GenTL producer, harvesters). Both play what can be told apart, so that each sample and each
frame of the session is accounted for afterwards. The engine takes frames between records, as its plans do, one after
another as fast as the camera and the polarizer, which is asked after each, answer; audio goes on all the time. The
window watches through the live process, in the phases of ``speed.gui``. Switches, trolley and polarizer are simulated
at the wire.
"""

from __future__ import annotations

import contextlib
import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import wire_camera
from benchmarks.full_rate import ADDRESS, LINK_BITS_PER_S, PACKET_BYTES, RATE_HZ, SHAPE, program
from benchmarks.gui_rows import load, phase_rows, watch
from benchmarks.rows import Row
from benchmarks.speed_gui import LOSSES, loss_row
from benchmarks.tape_card import place_on, tape
from drivers.camera.producers import aravis_producer
from drivers.records import Channel
from hw_mocks.grbl import start_grbl
from hw_mocks.rotator import start_rotator
from hw_mocks.sound_card import available_paths
from hw_mocks.switch_box import start_switch_box
from hw_mocks.world import World
from polfuse_lab.plans.custom import CustomPlan, custom_plan
from polfuse_lab.plans.files import plan_to_toml
from polfuse_lab.plans.steps import Checkpoint, Expose, MoveTo, RecordSweeps, SelectChannel, Step, TurnPolarizer
from polfuse_lab.session.reader import open_session

SWEEP_S = 0.04
EXPOSURE_S = 0.001
SWEEPS = 8
FRAMES = 90
"""At each angle: one and a half seconds."""
CHANNELS = (Channel.HH, Channel.HV, Channel.VV, Channel.VH)
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
LENGTH_M = 3.2
POSITIONS = 200
"""More than there is time for: the window aborts the collect when it has seen enough."""

RIG = """\
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = {sweep_s}
[geometry]
antenna_height_m = 1.069
[radar]
driver = "sounddevice"
sample_rate_hz = {rate}
options = {{device = "{device}", latency_s = 0.02, guard_s = 0.03, environment = {environment}}}
[switches]
driver = "dowkey_ms"
settle_s = 0.03
options = {{port = "{switches}", settle_s = 0.03, cycles_folder = "{folder}"}}
[trolley]
driver = "grbl"
length_m = {length}
speed_m_s = 0.5
options = {{port = "{trolley}", length_m = {length}, feed_m_s = 0.5}}
[camera]
driver = "harvesters"
pixel_format = "Mono16"
height_px = {rows}
width_px = {columns}
exposure_s = {exposure_s}
focal_length_m = 0.008
pixel_pitch_m = 8.3e-6
options = {{cti = "aravis", addresses = ["{camera}"], packet_size_bytes = {packet}}}
[polarizer]
driver = "ell14"
options = {{port = "{polarizer}", home_at_open = false}}
"""


@dataclass
class Account:
    """What a session holds."""

    samples: int = 0
    records: int = 0
    frames: int = 0
    frames_missing: int = 0
    frames_hz: float = 0.0
    """Rate within the series, by the middle one of the times from frame to frame."""
    problems: list[str] = field(default_factory=list)


def run(quick: bool) -> list[Row]:
    """Record, watch and account; ``quick`` for 3 s of each phase instead of 12 s."""
    if aravis_producer() is None or "pulse" not in available_paths():
        missing = "PulseAudio or the GenTL producer (make gentl) is not installed"
        return [Row("speed.gui_collect", "", None, True, "nothing lost", error=f"not measured: {missing}")]
    seconds = 3.0 if quick else 12.0
    with tempfile.TemporaryDirectory() as scratch, _rig(Path(scratch)) as rig:
        folder = Path(scratch)
        plan, session = folder / "plan.toml", folder / "session.h5"
        plan.write_text(plan_to_toml(_plan()))
        done = watch(folder, seconds, "--collect", str(rig), str(plan), str(session))
        if isinstance(done, str):
            return [Row("speed.gui_collect", "", None, False, "the window lives", error=done)]
        outcome = done["outcome"]
        if not done["phases"] or outcome.get("session") is None:
            words = f"{outcome.get('state')}: {outcome.get('reason')}"
            return [Row("speed.gui_collect", "", None, False, "the collect runs", error=words)]
        account = examine(Path(outcome["session"]))
    rows = [row for phase in done["phases"] for row in phase_rows("speed.gui_collect", phase)]
    before, after = done["health"]
    lost = {name: after[name] - before[name] for name in LOSSES}
    return [_kept_row(outcome, account), *rows, loss_row("speed.gui_collect", lost, after["restarts"])]


@contextlib.contextmanager
def _rig(folder: Path) -> Iterator[Path]:
    """The simulated devices; yields the rig file that reaches them."""
    world = World()
    words = [str(number) for number in (*SHAPE, LINK_BITS_PER_S)]
    with (
        program("benchmarks.tape_card", str(RATE_HZ), str(SWEEP_S)) as card_told,
        program("benchmarks.wire_camera", ADDRESS, *words) as camera,
        start_switch_box(world, actuation_s=0.015) as switches,
        start_grbl(world, length_m=LENGTH_M) as trolley,
        start_rotator(world) as polarizer,
    ):
        card = json.loads(card_told)
        environment = ", ".join(f"{name} = {json.dumps(value)}" for name, value in card["environment"].items())
        rig = folder / "rig.toml"
        rig.write_text(
            RIG.format(
                sweep_s=SWEEP_S, rate=RATE_HZ, device=card["device"], environment=f"{{{environment}}}",
                switches=switches.url, trolley=trolley.url, polarizer=polarizer.url, folder=folder, length=LENGTH_M,
                camera=camera.strip(), rows=SHAPE[0], columns=SHAPE[1], exposure_s=EXPOSURE_S, packet=PACKET_BYTES,
            )
        )  # fmt: skip
        yield rig


def _plan() -> CustomPlan:
    """All channels, then all angles, at each position."""
    steps: list[Step] = []
    for position in range(POSITIONS):
        steps.append(MoveTo(0.005 * (position - POSITIONS // 2), position))
        for channel in CHANNELS:
            steps += [SelectChannel(channel), RecordSweeps(SWEEPS, position, channel)]
        for angle_deg in ANGLES_DEG:
            steps += [TurnPolarizer(math.radians(angle_deg)), Expose(FRAMES, math.radians(angle_deg))]
        steps.append(Checkpoint(position))
    return custom_plan(steps, name="full rate")


def examine(path: Path) -> Account:
    """Account for each sample and each frame of a session from tape and wire.

    All records lie on the tape in the same place beside the device's own count of samples, so that none is missing
    between them either; each frame shows its number, and none between two of them is missing.
    """
    found, played = Account(), tape(RATE_HZ, SWEEP_S)
    places: set[int] = set()
    numbers: set[int] = set()
    last = None
    with open_session(path) as session:
        for index, row in enumerate(session.sweeps):
            samples = session.audio(index)
            place = place_on(played, samples)
            if place is None:
                found.problems.append(f"audio record {index} is not what was played")
            else:
                places.add((place - int(row["device_frame"])) % RATE_HZ)
            found.samples, found.records = found.samples + len(samples), found.records + 1
        for index, row in enumerate(session.frames):
            block_id, number = int(row["frame_id"]), wire_camera.number_of(session.frame(index))
            if number is None:
                found.problems.append(f"frame {index} shows no number")
            else:
                numbers.add((block_id - number) % wire_camera.CYCLE)
            found.frames_missing += 0 if last is None else (block_id - last) % 0xFFFF - 1
            found.frames, last = found.frames + 1, block_id
        if len(session.frames) > 1:
            found.frames_hz = 1e9 / float(np.median(np.diff(session.frames["t_host_ns"].astype(np.int64))))
    if len(places) > 1:
        found.problems.append("audio samples are missing between records")
    if len(numbers) > 1:
        found.problems.append("frames and their numbers do not go together")
    return found


def _kept_row(outcome: dict[str, Any], account: Account) -> Row:
    lost, frames_lost = outcome["samples_lost"], outcome["frames_lost"]
    complete = account.records == outcome["sweeps"] and account.frames == outcome["frames"]
    words = (
        f"speed.gui_collect: in {outcome['seconds']:.0f} s {account.samples} samples of audio ({lost} lost) and "
        f"{account.frames} frames, {account.frames_hz:.0f} a second ({frames_lost} lost, "
        f"{account.frames_missing} missing), as they were (load {load():.1f})"
    )
    sound = complete and lost == frames_lost == account.frames_missing == 0 and not account.problems
    target = "acquisition loses nothing while the window is dragged, resized and flooded"
    return Row(words, "", None, sound, target, error="; ".join(account.problems[:3]) or None)
