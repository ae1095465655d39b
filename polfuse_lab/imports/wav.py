"""Stereo WAV recordings of an FMCW radar (beat and sync) into a session."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from drivers.records import AudioBlock, Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.foreign_rig import DEFAULT_BANDWIDTH_HZ, DEFAULT_CENTRE_HZ, radar_assumptions
from polfuse_lab.imports.formats import Imported
from polfuse_lab.imports.riff import Wav, read_wav
from polfuse_lab.records import Sweeps
from polfuse_lab.rig import Waveform
from polfuse_lab.session import SessionConfig, SessionWriter
from processing.errors import DataError
from processing.radar.bursts import find_bursts
from processing.radar.ramp_direction import ramp_direction
from processing.radar.sync import Polarity, Sync, find_sync


@dataclass(frozen=True)
class WavImport:
    """What was imported."""

    session: Path
    sweeps: int
    """Whole up-ramps in all files."""
    sync_channel: int
    sync_inverted: bool
    polarity_from: str
    """How the polarity is known: ``"given"``, ``"duration"``, ``"motion"`` or ``"convention"``."""
    sweep_period_s: float
    ramp_up_s: float
    jitter_s: float
    bandwidth_hz: float
    bandwidth_assumed: bool
    centre_hz: float
    notes: tuple[str, ...]
    """What the user should know about the numbers."""


def import_wav(
    files: Sequence[Path | str],
    session: Path | str,
    *,
    bandwidth_hz: float | None = None,
    centre_hz: float | None = None,
    nominal_period_s: float = 0.040,
    polarity: Polarity = "auto",
    channel: Channel = Channel.VV,
) -> WavImport:
    """Write stereo WAV recordings into a new session, one audio record for each, at positions 0, 1, …

    Which channel is the sync, its polarity and its period are measured in each file and must agree. A WAV file does
    not tell its radar's bandwidth and frequency: where they are not given the thesis's are assumed, and the session
    says so. All ranges and speeds scale with 1 / bandwidth.

    Args:
        files: WAV files of one radar.
        session: name of the session to write; must not exist.
        bandwidth_hz: frequency swept in one up-ramp, Hz.
        centre_hz: centre frequency, Hz.
        nominal_period_s: expected sweep period, s; the true one may differ by a factor of 1.6.
        polarity: which level of the sync is the up-ramp, where it is known.
        channel: polarimetric channel (the thesis's ranging mode transmits and receives V).

    Raises:
        PolfuseError: a file cannot be used, files disagree, or the session cannot be written.
    """
    if not files:
        raise PolfuseError("no file is given", where="import", advice="name at least one WAV file")
    paths = [Path(file) for file in files]
    wavs = [read_wav(path) for path in paths]
    syncs = [_sync(path, wav, nominal_period_s, polarity) for path, wav in zip(paths, wavs, strict=True)]
    check_agreement(paths, wavs, syncs)
    first = max(syncs, key=lambda sync: sync.polarity_from in ("motion", "duration"))
    notes = _notes(bandwidth_hz is None, centre_hz is None, first)
    period = float(np.median([sync.period_s for sync in syncs]))
    ramp = float(np.median([sync.ramp_s for sync in syncs]))
    try:
        waveform = Waveform(
            centre_hz=DEFAULT_CENTRE_HZ if centre_hz is None else centre_hz,
            bandwidth_hz=DEFAULT_BANDWIDTH_HZ if bandwidth_hz is None else bandwidth_hz,
            ramp_up_s=ramp,
            sweep_period_s=max(period, ramp),
        )
    except ValidationError as error:
        raise PolfuseError(
            f"the waveform is impossible ({error.errors()[0]['msg']})", where="import",
            advice="give a bandwidth and a centre frequency in Hz, the bandwidth below twice the frequency",
        ) from error  # fmt: skip
    config = SessionConfig(
        source="import:wav",
        waveform=waveform,
        sample_rate_hz=wavs[0].sample_rate_hz,
        sample_dtype=wavs[0].samples.dtype.name,
        audio_block_frames=max(len(wav.samples) for wav in wavs),
        extra={
            "files": [file_provenance(path, wav) for path, wav in zip(paths, wavs, strict=True)],
            "bandwidth_assumed": bandwidth_hz is None,
            "centre_assumed": centre_hz is None,
            "sync_channel": first.channel,
            "sync_inverted": first.inverted,
            "polarity_from": first.polarity_from,
            "notes": list(notes),
        },
    )
    now = time.monotonic_ns()
    size = sum(wav.samples.nbytes for wav in wavs)
    with SessionWriter.create(session, config, expected_bytes=size) as writer:
        for position, wav in enumerate(wavs):
            block = AudioBlock(wav.samples, wav.sample_rate_hz, first_frame=0, t_device_s=0.0, t_host_ns=now)
            writer.write(Sweeps(block, channel, position))
            now += int(len(wav.samples) / wav.sample_rate_hz * 1e9)
            writer.flush()
        written = writer.close("finished", f"imported from {', '.join(path.name for path in paths)}")
    return WavImport(
        session=written,
        sweeps=sum(len(sync.starts) for sync in syncs),
        sync_channel=first.channel,
        sync_inverted=first.inverted,
        polarity_from=first.polarity_from,
        sweep_period_s=period,
        ramp_up_s=ramp,
        jitter_s=float(np.median([sync.jitter_samples / sync.sample_rate_hz for sync in syncs])),
        bandwidth_hz=waveform.bandwidth_hz,
        bandwidth_assumed=bandwidth_hz is None,
        centre_hz=waveform.centre_hz,
        notes=notes,
    )


def run(
    files: Sequence[Path],
    output: Path,
    *,
    bandwidth_hz: float | None = None,
    centre_hz: float | None = None,
    sweep_period_s: float = 0.040,
    up_ramp: Polarity = "auto",
    channel: str = "VV",
) -> Imported:
    """:func:`import_wav` for the command line."""
    done = import_wav(
        files,
        output,
        bandwidth_hz=bandwidth_hz,
        centre_hz=centre_hz,
        nominal_period_s=sweep_period_s,
        polarity=up_ramp,
        channel=Channel[channel],
    )
    level = "low" if done.sync_inverted else "high"
    text = "\n".join(
        [
            f"{done.sweeps} sweeps of {done.sweep_period_s * 1e3:.3f} ms; sync on channel {done.sync_channel}, "
            f"up-ramp while {level} (by {done.polarity_from})",
            f"centre {done.centre_hz / 1e9:.4g} GHz, bandwidth {done.bandwidth_hz / 1e6:.4g} MHz",
            *(f"note: {note}" for note in done.notes),
            f"session: {done.session}",
        ]
    )
    return Imported(asdict(done), text)


def _sync(path: Path, wav: Wav, nominal_period_s: float, polarity: Polarity) -> Sync:
    if wav.samples.shape[1] != 2:
        raise PolfuseError(
            f"has {wav.samples.shape[1]} channel(s), not beat and sync in two",
            where=str(path), advice="record in stereo")  # fmt: skip
    try:
        sync = find_sync(wav.samples, wav.sample_rate_hz, nominal_period_s=nominal_period_s, polarity=polarity)
        if sync.polarity_from == "convention":
            sync = ramp_direction(wav.samples, sync) or sync
    except DataError as error:
        raise PolfuseError(
            error.what, where=str(path), advice=_bursts_advice(wav, nominal_period_s) or error.advice
        ) from error
    return sync


def _bursts_advice(wav: Wav, nominal_period_s: float) -> str | None:
    """What to do with a recording that holds no steady sync since the radar was switched off in between."""
    try:
        bursts = find_bursts(wav.samples, wav.sample_rate_hz, nominal_period_s=nominal_period_s).bursts
    except DataError:
        return None
    if len(bursts) < 2:
        return None
    return f"it holds {len(bursts)} bursts of sweeps with silence between them: import a rail recording as sar-wav"


def check_agreement(paths: Sequence[Path], wavs: Sequence[Wav], syncs: Sequence[Sync]) -> None:
    """All files must come from one radar on one sound card.

    Raises:
        PolfuseError: a file differs from the first one in rate, type, sync channel, polarity or period.
    """
    known = [sync.inverted for sync in syncs if sync.polarity_from != "convention"] or [syncs[0].inverted]
    for path, wav, sync in zip(paths, wavs, syncs, strict=True):
        differs = None
        if (wav.sample_rate_hz, wav.samples.dtype) != (wavs[0].sample_rate_hz, wavs[0].samples.dtype):
            differs = "another sample rate or type"
        elif sync.channel != syncs[0].channel:
            differs = "the sync on the other channel"
        elif sync.polarity_from != "convention" and sync.inverted != known[0]:
            differs = "the sync inverted"
        elif abs(sync.period_s / syncs[0].period_s - 1) > 0.02:
            differs = f"a sweep period of {sync.period_s * 1e3:.2f} ms instead of {syncs[0].period_s * 1e3:.2f} ms"
        if differs:
            raise PolfuseError(
                f"has {differs} than {paths[0].name}" if "than" not in differs else f"has {differs}",
                where=str(path),
                advice="import recordings of different radars or settings into sessions of their own",
            )


def _notes(bandwidth_assumed: bool, centre_assumed: bool, sync: Sync) -> tuple[str, ...]:
    notes = [*radar_assumptions(not bandwidth_assumed, not centre_assumed)]
    if sync.polarity_from == "convention":
        notes.append("both levels of the sync last equally long: the high one is taken for the up-ramp")
    return tuple(notes)


def file_provenance(path: Path, wav: Wav) -> dict[str, str | int | float]:
    """Where samples came from, for the session's configuration: JSON values."""
    return {
        "name": path.name,
        "sha256": wav.sha256,
        "frames": len(wav.samples),
        "bits": wav.bits,
        "sample_rate_hz": wav.sample_rate_hz,
    }
