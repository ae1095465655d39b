"""What the writer sustains, and what acquisition notices of it.

Records of the mix (192 kHz stereo int16, 782 x 582 uint16 at 60 fps, with the noise of a real signal) go through the
queue and the writer's process into a session, as fast as they are taken; the peer is h5py alone, appending the same
arrays to two plain datasets with the same chunks and filter in this process. Each is done several times in turn.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.counting_rig import FRAME_HZ, RATE_HZ, SHAPE, rig
from benchmarks.full_rate import counting_card, cpu_seconds, sound_port
from benchmarks.rows import Row
from drivers.radar.sound_port import SoundPort
from drivers.records import AudioBlock, Channel, Frame
from hw_mocks.sound_card import available_paths
from polfuse_lab.engine.recorder import WriterProcess
from polfuse_lab.records import Exposure, Record, Sweeps
from polfuse_lab.session import SessionConfig

TARGET = 10.0
"""Times the rig's data rate."""
RECORD_FRAMES = RATE_HZ // 2
MIX_BYTES_PER_S = RATE_HZ * 4 + FRAME_HZ * SHAPE[0] * SHAPE[1] * 2
POLL_S = 0.002

Half = tuple[NDArray[np.int16], list[NDArray[np.uint16]]]
"""Half a second of the mix: audio, and frames."""


def run(quick: bool) -> list[Row]:
    """20 s of the mix, 5 times; 2 s, twice, when quick."""
    seconds, times = (2, 2) if quick else (20, 5)
    halves = _material()
    ours, by_cpu, peers = [], [], []
    with tempfile.TemporaryDirectory(prefix="polfuse-write-path-") as folder:
        for number in range(times):
            peers.append(_plain(Path(folder) / f"plain-{number}.h5", halves, seconds))
            rate, rate_by_cpu = _written(Path(folder) / f"session-{number}.h5", halves, seconds)
            ours.append(rate)
            by_cpu.append(rate_by_cpu)
    ratios = [a / b for a, b in zip(ours, peers, strict=True)]
    rate, rates = statistics.median(ours), f"{min(ours):.1f} to {max(ours):.1f}"
    megabytes = rate * MIX_BYTES_PER_S / 1e6
    load = os.getloadavg()[0]
    words = f"at least {TARGET:g} times {MIX_BYTES_PER_S / 1e6:.1f} MB/s; {rates} times, median {megabytes:.0f} MB/s"
    rows = [
        Row("reliability.write_path.rate", "", rate / TARGET, rate >= TARGET, f"{words}, load {load:.1f}"),
        Row(
            "reliability.write_path.processor",
            "",
            statistics.median(by_cpu) / TARGET,
            True,
            "informative: times the data rate for each second of the writer's processor time, whatever the load",
            ratio_min=min(by_cpu) / TARGET,
            ratio_max=max(by_cpu) / TARGET,
        ),
        Row(
            "reliability.write_path.peer",
            "h5py",
            statistics.median(ratios),
            True,
            "informative: the rate of plain appends in one process, without tables, queue or a process of its own",
            ratio_min=min(ratios),
            ratio_max=max(ratios),
        ),
    ]
    return rows + _jitter(halves, 3.0 if quick else 30.0)


def _material() -> list[Half]:
    """Arrays that are as hard to compress as a real signal: a beat under noise, and 12 bits with shot noise."""
    rng = np.random.default_rng(1)
    t = np.arange(RECORD_FRAMES) / RATE_HZ
    made: list[Half] = []
    for _ in range(2):
        beat = 8000 * np.sin(2 * np.pi * 1000 * t) + rng.normal(0, 300, RECORD_FRAMES)
        sync = 12_000 * np.where(t % 0.04 < 0.02, 1, -1) + rng.normal(0, 50, RECORD_FRAMES)
        audio = np.stack([beat, sync], axis=1).astype(np.int16)
        level = np.add.outer(np.linspace(200, 3000, SHAPE[0]), np.linspace(-100, 100, SHAPE[1]))
        frames = [
            np.clip(level + rng.normal(0, 1, SHAPE) * np.sqrt(level), 0, 4095).astype(np.uint16)
            for _ in range(FRAME_HZ // 2)
        ]
        made.append((audio, frames))
    return made


def _config() -> SessionConfig:
    return SessionConfig(
        source="collect",
        waveform=rig().waveform,
        sample_rate_hz=RATE_HZ,
        audio_block_frames=RECORD_FRAMES,
        frame_shape=SHAPE,
    )


def _offer(writer: WriterProcess, record: Record) -> None:
    while not writer.offer(record):
        time.sleep(POLL_S)


def _written(path: Path, halves: list[Half], seconds: int) -> tuple[float, float]:
    """Seconds of the mix written in one second, and in one second of the writer's processor time, through the queue
    into a flushed session."""
    writer = WriterProcess(path)
    writer.open(_config())
    began, cpu_s = time.monotonic(), cpu_seconds(writer.pid)
    number = 0
    for half in range(2 * seconds):
        audio, images = halves[half % len(halves)]
        _offer(writer, Sweeps(AudioBlock(audio, RATE_HZ, half * RECORD_FRAMES, 0.5 * half, 0), Channel.HH, half))
        for image in images:
            number += 1
            _offer(writer, Exposure(Frame(image, number, 0.001, 0.0, 0.0, 0), 0.0))
    ticket = writer.flush()
    while not writer.flushed(ticket):
        time.sleep(POLL_S)
    took, cpu_s = time.monotonic() - began, cpu_seconds(writer.pid) - cpu_s
    writer.close("finished", "")
    path.unlink()
    return seconds / took, seconds / max(cpu_s, 0.01)


def _plain(path: Path, halves: list[Half], seconds: int) -> float:
    """The same by h5py alone."""
    import h5py
    import hdf5plugin

    bitshuffle = hdf5plugin.Bitshuffle(cname="lz4")
    with h5py.File(path, "w", libver=("v110", "v110")) as file:
        chunk = _config().chunk_frames
        audio = file.create_dataset("audio", (0, 2), "i2", maxshape=(None, 2), chunks=(chunk, 2), **bitshuffle)
        limit, one = (None, *SHAPE), (1, *SHAPE)
        images = file.create_dataset("images", (0, *SHAPE), "u2", maxshape=limit, chunks=one, **bitshuffle)
        began = time.monotonic()
        for half in range(2 * seconds):
            samples, frames = halves[half % len(halves)]
            # As in a session, each record begins with a chunk of its own.
            first = -(-audio.shape[0] // chunk) * chunk
            audio.resize(first + len(samples), axis=0)
            audio[first:] = samples
            for image in frames:
                images.resize(images.shape[0] + 1, axis=0)
                images[-1] = image
        file.flush()
        os.fsync(file.id.get_vfd_handle())
        took = time.monotonic() - began
    path.unlink()
    return seconds / took


def _jitter(halves: list[Half], seconds: float) -> list[Row]:
    """How late the loop that polls comes round, and records are complete: with the writer idle, at the rig's rate, and
    as busy as it can be."""
    if "pulse" not in available_paths():
        return [Row("reliability.write_path.jitter", "", None, True, "skipped: PulseAudio is not installed")]
    with counting_card() as card:
        radar = sound_port(card)
        radar.open()
        try:
            cases = {"idle": 0.0, "at_full_rate": 1.0, "saturated": 1000.0}
            return [_jitter_row(name, radar, halves, rate, seconds) for name, rate in cases.items()]
        finally:
            radar.close()


def _jitter_row(name: str, radar: SoundPort, halves: list[Half], rate: float, seconds: float) -> Row:
    lost, polls, records = radar.lost_frames, [], []
    with tempfile.TemporaryDirectory(prefix="polfuse-jitter-") as folder:
        writer = WriterProcess(Path(folder) / "s.h5")
        writer.open(_config())
        begin = last = time.monotonic()
        given = 0
        radar.begin(RECORD_FRAMES)
        asked = begin
        while (now := time.monotonic()) - begin < seconds:
            polls.append(now - last)
            last = now
            if given < rate * (now - begin) * FRAME_HZ:
                image = halves[0][1][given % (FRAME_HZ // 2)]
                # What finds no room is offered again later, as the scheduler does.
                given += int(writer.offer(Exposure(Frame(image, given, 0.001, 0.0, 0.0, 0), 0.0)))
            block = radar.poll()
            if block is not None:
                records.append(now - asked - len(block.samples) / RATE_HZ)
                asked = now
                radar.begin(RECORD_FRAMES)
                while not writer.offer(Sweeps(block, Channel.HH, 0)):
                    time.sleep(POLL_S)
            time.sleep(POLL_S)
        radar.cancel()
        writer.close("finished", "")
    late = np.array(polls[1:]) - POLL_S
    words = (
        f"poll late by {_spread(late)}, record complete after its last sample by {_spread(np.array(records))},"
        f" longest callback {radar.longest_callback_s * 1e3:.1f} ms, {given / seconds:.0f} frames/s,"
        f" load {os.getloadavg()[0]:.1f}"
    )
    missing = radar.lost_frames - lost
    return Row(f"reliability.write_path.jitter_{name}", "", None, missing == 0, words, error=f"{missing} frames lost")


def _spread(seconds: NDArray[np.float64]) -> str:
    """Median, 99th percentile and maximum, ms."""
    if not len(seconds):
        return "nothing"
    median, most, largest = (1e3 * float(value) for value in np.percentile(seconds, (50, 99, 100)))
    return f"{median:.1f} / {most:.1f} / {largest:.1f} ms (median, 99 %, most)"
