"""Stereo WAV recordings of a cart pushed from mark to mark, the radar switched off in between, into a session.

Each burst of sweeps becomes one audio record at its position; the silences in between are left out. Which channel is
the sync and its period are measured; its polarity too, by the length of its levels or by which of them gives an image.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.records import AudioBlock, Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.foreign_rig import POSITION_SD_M, ForeignRig, RadarFacts, foreign_rig
from polfuse_lab.imports.frames import FrameSet, provenance, write_frames
from polfuse_lab.imports.positions import Placed, Wishes, place
from polfuse_lab.imports.riff import Wav, read_wav
from polfuse_lab.imports.stops import Recording, listen, stops_of
from polfuse_lab.imports.up_ramp import up_ramp_by_focus
from polfuse_lab.imports.wav import check_agreement, file_provenance
from polfuse_lab.records import SweepFlag, Sweeps
from polfuse_lab.session import SessionConfig, SessionWriter
from processing.radar.sync import Polarity

DEFAULT_STEP_M = 0.0508
"""Distance between positions, m: 2 inches, as in the thesis and in the MIT course."""


@dataclass(frozen=True)
class SarWavImport:
    """What was imported."""

    session: Path
    positions: int
    channels: tuple[str, ...]
    step_m: float
    sweeps: int
    """Whole up-ramps in all records."""
    sync_channel: int
    sync_inverted: bool
    polarity_from: str
    """How the polarity is known: ``"given"``, ``"duration"``, ``"focus"`` or ``"convention"``."""
    sweep_period_s: float
    ramp_up_s: float
    jitter_s: float
    bandwidth_hz: float
    centre_hz: float
    frames: int
    """Camera frames."""
    notes: tuple[str, ...]
    """What the user should know about the numbers."""


def import_sar_wav(
    files: Sequence[Path | str],
    session: Path | str,
    *,
    channels: Sequence[Channel],
    step_m: float = DEFAULT_STEP_M,
    wishes: Mapping[Channel, Wishes] | None = None,
    rig: Path | None = None,
    bandwidth_hz: float | None = None,
    centre_hz: float | None = None,
    antenna_height_m: float | None = None,
    nominal_period_s: float = 0.040,
    polarity: Polarity = "auto",
    frames: FrameSet | None = None,
) -> SarWavImport:
    """Write recordings of a hand-pushed rail collect, one file for each channel, into a new session.

    Positions are ``step_m`` apart and centred on x = 0. A ramp that does not tell its direction by its length is taken
    the way that gives the sharper image (:func:`polfuse_lab.imports.up_ramp.up_ramp_by_focus`).

    Args:
        files: one WAV file for each channel, all of one radar and one rail.
        session: name of the session to write; must not exist.
        channels: channel of each file.
        step_m: distance between positions, m; negative where the cart was pushed towards -x.
        wishes: what the user says about the bursts of each channel's file.
        rig: rig file of the radar; one is made of the other arguments and the thesis's values where left out.
        bandwidth_hz: frequency swept in one up-ramp, Hz.
        centre_hz: centre frequency, Hz.
        antenna_height_m: height of the antennas above the ground, m.
        nominal_period_s: expected sweep period, s; the true one may differ by a factor of 1.6.
        polarity: which level of the sync is the up-ramp, where it is known.
        frames: polarizer frames of the same scene.

    Raises:
        PolfuseError: a file cannot be used, files disagree, it is not clear what the positions are, a wrong rig file,
            or the session cannot be written.
    """
    _check(files, channels, step_m)
    paths = [Path(file) for file in files]
    camera = None if frames is None else frames.camera
    told = RadarFacts(bandwidth_hz, centre_hz, antenna_height_m)
    wanted = foreign_rig(rig, told, camera).rig.waveform
    wavs = [read_wav(path) for path in paths]
    recordings = [listen(path, wav, nominal_period_s, polarity) for path, wav in zip(paths, wavs, strict=True)]
    check_agreement(paths, wavs, [recording.sync for recording in recordings])
    placed, notes = _place_all(paths, recordings, channels, wishes or {}, wanted.centre_hz, wanted.bandwidth_hz)
    count = placed[0][-1].position + 1
    x_m = np.asarray((np.arange(count) - (count - 1) / 2) * step_m, dtype=np.float64)
    inverted, polarity_from = _polarity(recordings, placed, x_m, wanted.centre_hz, wanted.bandwidth_hz)
    if polarity_from == "convention":
        notes.append("both levels of the sync last equally long and the echoes do not tell: high is taken for up")
    syncs = [recording.used(items, inverted) for recording, items in zip(recordings, placed, strict=True)]
    every = [sync for some in syncs for sync in some]
    made = foreign_rig(
        rig,
        replace(
            told,
            ramp_up_s=float(np.median([sync.ramp_s for sync in every])),
            sweep_period_s=float(np.median([sync.period_s for sync in every])),
            sample_rate_hz=wavs[0].sample_rate_hz,
            rail_length_m=max(count - 1, 1) * abs(step_m),
        ),
        camera,
    )
    notes = [*made.notes, *(() if frames is None else frames.notes), *notes]
    config = SessionConfig(
        source="import:sar-wav",
        waveform=made.waveform,
        sample_rate_hz=wavs[0].sample_rate_hz,
        sample_dtype=wavs[0].samples.dtype.name,
        audio_block_frames=max(burst.samples for recording in recordings for burst in recording.bursts),
        frame_shape=None if frames is None else frames.shape,
        frame_dtype="uint16" if frames is None else frames.dtype,
        rig_toml=made.text,
        extra={
            "files": [
                file_provenance(path, wav) | {"channel": channel.name}
                for path, wav, channel in zip(paths, wavs, channels, strict=True)
            ],
            "frame_files": [] if frames is None else provenance(frames),
            "step_m": step_m,
            "sync_channel": recordings[0].sync.channel,
            "sync_inverted": inverted,
            "polarity_from": polarity_from,
            "notes": notes,
        },
    )
    written, shown = _write(session, config, wavs, recordings, channels, placed, x_m, made, frames)
    return SarWavImport(
        session=written,
        positions=count,
        channels=tuple(channel.name for channel in channels),
        step_m=step_m,
        sweeps=sum(len(sync.starts) for sync in every),
        sync_channel=recordings[0].sync.channel,
        sync_inverted=inverted,
        polarity_from=polarity_from,
        sweep_period_s=made.waveform.sweep_period_s,
        ramp_up_s=made.waveform.ramp_up_s,
        jitter_s=float(np.median([recording.sync.jitter_samples for recording in recordings])) / wavs[0].sample_rate_hz,
        bandwidth_hz=made.waveform.bandwidth_hz,
        centre_hz=made.waveform.centre_hz,
        frames=shown,
        notes=tuple(notes),
    )


def _check(files: Sequence[Path | str], channels: Sequence[Channel], step_m: float) -> None:
    if not files:
        raise PolfuseError("no file is given", where="import", advice="name one WAV file for each channel")
    if len(files) != len(channels):
        raise PolfuseError(
            f"{len(channels)} channel(s) are given for {len(files)} file(s)", where="import",
            advice="name the channel of each file, in their order, such as --channels HH,HV,VH,VV",
        )  # fmt: skip
    if len(set(channels)) < len(channels):
        raise PolfuseError("a channel is given twice", where="import", advice="give each file a channel of its own")
    if not (math.isfinite(step_m) and 0 < abs(step_m) <= 100):
        raise PolfuseError(
            f"a step of {step_m:g} m makes no aperture", where="import",
            advice="give the distance between marks in metres, negative where the cart was pushed the other way",
        )  # fmt: skip


def _place_all(
    paths: Sequence[Path],
    recordings: Sequence[Recording],
    channels: Sequence[Channel],
    wishes: Mapping[Channel, Wishes],
    centre_hz: float,
    bandwidth_hz: float,
) -> tuple[list[list[Placed]], list[str]]:
    """Positions of every recording, as many in each."""
    placed: list[list[Placed]] = []
    notes: list[str] = []
    for path, recording, channel in zip(paths, recordings, channels, strict=True):
        stops = stops_of(recording, centre_hz=centre_hz, bandwidth_hz=bandwidth_hz)
        items, said = place(stops, wishes.get(channel, Wishes()), str(path))
        interrupted = [index + 1 for index, burst in enumerate(recording.bursts) if burst.interruptions]
        if interrupted:
            said.append(f"the sync was lost for a moment in burst {', '.join(map(str, interrupted[:8]))}")
        notes += said if len(paths) == 1 else [f"{path.name}: {text}" for text in said]
        placed.append(items)
    counts = [items[-1].position + 1 for items in placed]
    usual = max(counts, key=counts.count)
    for path, recording, count in zip(paths, recordings, counts, strict=True):
        if count != usual:
            other = paths[counts.index(usual)].name
            bursts = recording.bursts
            raise PolfuseError(
                f"holds {count} positions ({len(bursts)} bursts of {_seconds(recording)}), {other} holds {usual}",
                where=str(path),
                advice="all channels need the same positions: look for a missing or doubled one, and leave bursts out "
                "with --drop CHANNEL:NUMBER",
            )
    return placed, notes


def _seconds(recording: Recording) -> str:
    lengths = [burst.samples / recording.sync.sample_rate_hz for burst in recording.bursts]
    return f"{min(lengths):.2f} to {max(lengths):.2f} s"


def _polarity(
    recordings: Sequence[Recording],
    placed: Sequence[Sequence[Placed]],
    x_m: NDArray[np.float64],
    centre_hz: float,
    bandwidth_hz: float,
) -> tuple[bool, str]:
    """Whether the low level is the up-ramp, and how that is known."""
    first = recordings[0].sync
    if first.polarity_from != "convention":
        return first.inverted, first.polarity_from
    votes = []
    for recording, items in zip(recordings, placed, strict=True):
        told = up_ramp_by_focus(
            [recording.samples(item.burst) for item in items],
            recording.used(items, first.inverted),
            x_m[[item.position for item in items]],
            centre_hz=centre_hz,
            bandwidth_hz=bandwidth_hz,
        )
        if told is not None:
            votes.append(told)
    if votes and 2 * sum(votes) != len(votes):
        return 2 * sum(votes) > len(votes), "focus"
    return first.inverted, "convention"


def _write(
    session: Path | str,
    config: SessionConfig,
    wavs: Sequence[Wav],
    recordings: Sequence[Recording],
    channels: Sequence[Channel],
    placed: Sequence[Sequence[Placed]],
    x_m: NDArray[np.float64],
    made: ForeignRig,
    frames: FrameSet | None,
) -> tuple[Path, int]:
    """The session's path and how many frames it holds."""
    size = sum(wav.samples.nbytes for wav in wavs) + (0 if frames is None else frames.bytes)
    now = time.monotonic_ns()
    shown = 0
    with SessionWriter.create(session, config, expected_bytes=size) as writer:
        for wav, recording, channel, items in zip(wavs, recordings, channels, placed, strict=True):
            for item in items:
                burst = recording.bursts[item.burst]
                start_s = burst.start / wav.sample_rate_hz
                block = AudioBlock(
                    recording.samples(item.burst), wav.sample_rate_hz, burst.start, start_s, now + round(start_s * 1e9)
                )
                flags = SweepFlag.RETRY if item.attempt else SweepFlag.NONE
                place_m = float(x_m[item.position])
                writer.write(
                    Sweeps(block, channel, item.position, place_m, POSITION_SD_M, flags=flags, attempt=item.attempt)
                )
            writer.flush()
            now += int(len(wav.samples) / wav.sample_rate_hz * 1e9)
        if frames is not None and made.rig.camera is not None:
            camera = made.rig.camera
            exposure = camera.exposure_s if frames.camera.exposure_s is None else frames.camera.exposure_s
            shown = write_frames(writer, frames, exposure_s=exposure, gain_db=camera.gain_db, since_ns=now)
        names = [str(item["name"]) for item in config.extra["files"]]
        return writer.close("finished", f"imported from {', '.join(names)}"), shown
