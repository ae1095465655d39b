"""AFRL's Gotcha volumetric SAR collect (MATLAB files, one degree and one polarisation each) into a session.

A file holds a structure ``data``: echoes ``fp`` (frequencies, pulses), ``freq`` in Hz, antenna places ``x``, ``y``,
``z`` and their distance ``r0`` from the scene's centre in m, and the corrections ``af`` that an autofocus found. The
echoes carry these corrections already (without them the car park is as sharp as it gets, applied once more it blurs);
they are kept in the session. Phase is counted from the antenna's distance to the scene's centre, which is computed from
the places in float64: ``r0`` is float32, good to half a millimetre or a tenth of a radian at X band.
"""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.records import AudioBlock, Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.formats import Imported
from polfuse_lab.imports.matlab import read_matlab
from polfuse_lab.records import Sweeps
from polfuse_lab.rig import Waveform
from polfuse_lab.session import SessionConfig, SessionWriter
from processing.radar.phase_history import PhaseHistory

NOMINAL_RATE_HZ = 1e6
"""Sample rate that is written for samples which are frequencies, not instants."""

_NAME = re.compile(r"(?:^|[_\W])(HH|HV|VH|VV)(?:[_\W]|$)", re.IGNORECASE)


def import_gotcha(files: Sequence[Path | str], session: Path | str) -> tuple[Path, PhaseHistory]:
    """Write Gotcha files into a new session: one record of complex samples for each pulse and channel.

    Files of one polarisation are put one after the other in the order of azimuth; every polarisation needs the same
    pulses. The polarisation is read from the file's name (``..._HH.mat``).

    Args:
        files: MATLAB files, or one folder of them.
        session: name of the session to write; must not exist.

    Returns:
        The session's path, and what it holds.

    Raises:
        PolfuseError: there is no file, a file is not of this kind, files disagree, or the session cannot be written.
    """
    paths = _paths([Path(file) for file in files])
    parts: dict[str, list[tuple[Path, dict[str, NDArray[Any]]]]] = {}
    for path in paths:
        parts.setdefault(_channel(path), []).append((path, _read(path)))
    by_channel = {name: _joined(parts[name]) for name in sorted(parts)}
    reference = next(iter(by_channel.values()))
    for name, joined in by_channel.items():
        same = joined["fp"].shape == reference["fp"].shape and all(
            np.allclose(joined[key], reference[key], rtol=0, atol=0.05 if key != "freq" else 1e3)
            for key in ("antenna", "freq")
        )
        if not same:
            raise PolfuseError(
                f"{name} has other pulses or frequencies than {next(iter(by_channel))}", where=str(parts[name][0][0]),
                advice="give the same azimuths of every polarisation",
            )  # fmt: skip
    frequency, antenna = reference["freq"], reference["antenna"]
    history = PhaseHistory(
        np.stack([joined["fp"] for joined in by_channel.values()]),
        float(frequency[0]),
        float(frequency[-1] - frequency[0]) / (len(frequency) - 1),
        antenna,
        np.linalg.norm(antenna, axis=1),
        tuple(by_channel),
    )
    written = _write(Path(session), history, reference, [path.name for path in paths])
    return written, history


def run(files: Sequence[Path], output: Path) -> Imported:
    """:func:`import_gotcha` for the command line."""
    session, history = import_gotcha(files, output)
    channels, pulses, count = history.echoes.shape
    values = {
        "session": session,
        "sweeps": channels * pulses,
        "sync_channel": None,
        "sync_inverted": None,
        "sweep_period_s": None,
        "channels": list(history.channels),
        "pulses": pulses,
        "frequencies": count,
        "centre_hz": history.first_hz + 0.5 * (count - 1) * history.step_hz,
        "bandwidth_hz": history.bandwidth_hz,
    }
    text = (
        f"{pulses} pulses of {count} frequencies in {', '.join(history.channels)}: "
        f"{values['centre_hz'] / 1e9:.4g} GHz, {history.bandwidth_hz / 1e6:.4g} MHz\nsession: {session}"
    )
    return Imported(values, text)


def _paths(files: list[Path]) -> list[Path]:
    if len(files) == 1 and files[0].is_dir():
        files = sorted(files[0].glob("*.mat"))
        if not files:
            raise PolfuseError("holds no .mat files", where="import", advice="name the folder of one pass")
    if not files:
        raise PolfuseError("no file is given", where="import", advice="name at least one .mat file")
    if len(set(files)) < len(files):
        raise PolfuseError("a file is given twice", where="import", advice="name every file once")
    return files


def _channel(path: Path) -> str:
    found = _NAME.findall(path.stem)
    if not found:
        raise PolfuseError(
            "does not tell its polarisation", where=str(path), advice="keep the name it came with, ..._HH.mat"
        )
    return str(found[-1]).upper()


def _read(path: Path) -> dict[str, NDArray[Any]]:
    """Fields of one file: fp (pulses, frequencies), freq, antenna (pulses, 3), and the corrections."""
    data = read_matlab(path).get("data")
    needed = ("fp", "freq", "x", "y", "z")
    lacking = needed if not isinstance(data, dict) else [key for key in needed if not _is_numbers(data.get(key))]
    if lacking or not isinstance(data, dict):
        raise PolfuseError(
            f"is no MATLAB file of the Gotcha collect (no numbers in data.{lacking[0]})", where=str(path),
            advice="give the files as AFRL delivers them, data_3dsar_pass1_az001_HH.mat",
        )  # fmt: skip
    fp = np.asarray(data["fp"], dtype=np.complex64)
    frequency, *places = (_real(data[key], path, key) for key in needed[1:])
    correction = data.get("af")
    pulses, count = len(places[0]), len(frequency)
    fp = fp.reshape(count, pulses) if fp.size == count * pulses else fp
    if fp.shape != (count, pulses) or any(len(place) != pulses for place in places) or count < 2:
        raise PolfuseError(
            f"has echoes of shape {fp.shape} for {count} frequencies and {pulses} pulses", where=str(path),
            advice="give the file as AFRL delivers it",
        )  # fmt: skip
    if not (np.isfinite(fp).all() and np.isfinite(places).all() and np.isfinite(frequency).all()):
        raise PolfuseError("holds values that are not finite", where=str(path), advice="fetch the file again")
    step = (frequency[-1] - frequency[0]) / (count - 1)
    if step <= 0 or np.abs(frequency - frequency[0] - step * np.arange(count)).max() > 0.01 * step:
        raise PolfuseError("has frequencies that are not equidistant", where=str(path), advice="fetch the file again")
    corrected = correction if isinstance(correction, dict) else {}
    zero = np.zeros(pulses)
    return {
        "fp": fp.T,
        "freq": frequency,
        "antenna": np.stack(places, axis=1),
        "range": _real(corrected.get("r_correct", zero), path, "af.r_correct"),
        "phase": _real(corrected.get("ph_correct", zero), path, "af.ph_correct"),
    }


def _is_numbers(value: Any) -> bool:
    return isinstance(value, np.ndarray)


def _real(value: Any, path: Path, name: str) -> NDArray[np.float64]:
    """Real numbers in a row."""
    if not _is_numbers(value) or np.iscomplexobj(value):
        raise PolfuseError(
            f"holds no real numbers in data.{name}", where=str(path), advice="give the file as AFRL delivers it"
        )
    return np.asarray(value, dtype=np.float64).reshape(-1)


def _joined(parts: list[tuple[Path, dict[str, NDArray[Any]]]]) -> dict[str, NDArray[Any]]:
    """Files of one polarisation, one after the other by azimuth."""
    first = parts[0][1]
    for path, part in parts:
        if part["freq"].shape != first["freq"].shape or not np.allclose(part["freq"], first["freq"], rtol=0, atol=1e3):
            raise PolfuseError(
                f"has other frequencies than {parts[0][0].name}", where=str(path), advice="give files of one collect"
            )
    azimuth = [
        float(np.angle(np.mean(part["antenna"][:, 0] + 1j * part["antenna"][:, 1]))) % 6.283 for _, part in parts
    ]
    ordered = [parts[index][1] for index in np.argsort(azimuth, kind="stable")]
    joined = {key: np.concatenate([part[key] for part in ordered]) for key in ("fp", "antenna", "range", "phase")}
    return {**joined, "freq": first["freq"]}


def _write(session: Path, history: PhaseHistory, raw: dict[str, NDArray[Any]], names: list[str]) -> Path:
    _, pulses, count = history.echoes.shape
    ramp = count / NOMINAL_RATE_HZ
    config = SessionConfig(
        source="import:gotcha",
        waveform=Waveform(
            centre_hz=history.first_hz + count // 2 * history.step_hz,
            bandwidth_hz=history.bandwidth_hz,
            ramp_up_s=ramp,
            sweep_period_s=ramp,
        ),
        sample_rate_hz=NOMINAL_RATE_HZ,
        sample_dtype="float32",
        audio_block_frames=count,
        extra={
            "files": names,
            "phase_history": {
                "first_hz": history.first_hz,
                "step_hz": history.step_hz,
                "antenna_m": history.antenna_m.tolist(),
                "reference_m": history.reference_m.tolist(),
            },
            "corrections_applied": {"range_m": raw["range"].tolist(), "phase_rad": raw["phase"].tolist()},
            "notes": ["samples are real and imaginary parts of echoes at frequencies, not instants"],
        },
    )
    now = time.monotonic_ns()
    with SessionWriter.create(session, config, expected_bytes=history.echoes.nbytes) as writer:
        for pulse in range(pulses):
            for channel, name in enumerate(history.channels):
                samples = np.ascontiguousarray(history.echoes[channel, pulse]).view(np.float32).reshape(-1, 2)
                block = AudioBlock(samples, NOMINAL_RATE_HZ, first_frame=0, t_device_s=0.0, t_host_ns=now)
                writer.write(Sweeps(block, Channel[name], pulse, x_m=float(history.antenna_m[pulse, 0])))
            now += int(ramp * 1e9)
        return Path(writer.close("finished", f"imported from {', '.join(names[:4])}{' …' if len(names) > 4 else ''}"))
