"""What a plan will store, for the choice of its file's filter: bytes by kind, pace, and samples of what is expected."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.plans.costs import audio_frames, file_bytes, frame_pace_s, item_bytes, largest_record_frames
from polfuse_lab.plans.steps import Expose, Step
from polfuse_lab.rig import CameraSection, Rig
from polfuse_lab.session.filter_planner import Demand, FilterChoice, choose_filter, disk_bytes_per_s, forecast
from polfuse_lab.session.space import free_bytes
from processing.optics.series import SensorNoise

SAMPLE_ROWS = 256
"""Rows of the frame that stands for all."""
SAMPLE_FRAMES = 65_536
"""Audio frames of the record that stands for all."""
AUDIO_NOISE_BITS = 12
"""Bits of a sample below which there is noise alone, where no record of the radar is at hand: more than usual."""


def storage_choice(
    rig: Rig, listed: tuple[Step, ...], output: Path | str, *, audio: NDArray[Any] | None = None
) -> FilterChoice:
    """The filter for a plan's session on this machine.

    Args:
        rig: the rig.
        listed: the plan's steps.
        output: the session file.
        audio: (frames, inputs) samples that the radar was just heard with; noise stands for them if left out.
    """
    folder = Path(output).resolve().parent
    demand = storage_demand(rig, listed, folder)
    forecasts = {}
    if demand.raw_bytes["audio"]:
        sample = expected_audio(rig) if audio is None or not len(audio) else audio
        chunk = largest_record_frames(rig, listed, rig.radar.sample_rate_hz)
        forecasts["audio"] = forecast(sample[:SAMPLE_FRAMES], min(chunk, SAMPLE_FRAMES))
    if demand.raw_bytes["images"] and rig.camera is not None:
        forecasts["images"] = forecast(expected_frame(rig.camera)[None])
    return choose_filter(forecasts, demand)


def storage_demand(rig: Rig, listed: tuple[Step, ...], folder: Path) -> Demand:
    """What a plan stores in a folder that is there; the disk's speed is measured."""
    audio = sum(2 * item_bytes(rig) * audio_frames(rig, step) for step in listed)
    images = pace = 0.0
    if rig.camera is not None:
        size = rig.camera.width_px * rig.camera.height_px * np.dtype(rig.camera.counts_dtype).itemsize
        images = size * sum(step.frames for step in listed if isinstance(step, Expose))
        pace = size / frame_pace_s(rig) if images else 0.0
    if audio:
        pace += 2 * item_bytes(rig) * rig.radar.sample_rate_hz
    try:
        free: int | None = free_bytes(folder)
    except OSError:
        free = None
    return Demand(
        raw_bytes={"audio": int(audio), "images": int(images)},
        bytes_per_s=pace,
        disk_bytes_per_s=disk_bytes_per_s(folder),
        free_bytes=free,
        other_bytes=max(file_bytes(rig, listed) - int(audio + images), 0),
    )


def expected_frame(camera: CameraSection, seed: int = 1) -> NDArray[Any]:
    """A frame as the camera's noise has it: light from next to none to two thirds of saturation."""
    rng = np.random.default_rng(seed)
    rows, columns = min(camera.height_px, SAMPLE_ROWS), camera.width_px
    full = max(camera.saturation_counts - camera.black_level_counts, 1.0)
    light = full * np.linspace(0.02, 0.66, rows)[:, None] * np.linspace(0.5, 1.0, columns)
    noise = SensorNoise(camera.read_noise_counts, camera.electrons_per_count)
    counts = camera.black_level_counts + light + np.sqrt(noise.variance(light)) * rng.normal(size=light.shape)
    return np.asarray(np.clip(np.rint(counts), 0, camera.saturation_counts), dtype=camera.counts_dtype)


def expected_audio(rig: Rig, seed: int = 1) -> NDArray[Any]:
    """A second of noise beside a sync, (frames, 2)."""
    rng = np.random.default_rng(seed)
    rate = rig.radar.sample_rate_hz
    count = int(min(SAMPLE_FRAMES, max(rate, 1)))
    kind = str(rig.radar.options.get("sample_format", "int16"))
    dtype = np.dtype(kind if kind in ("int16", "int32", "float32") else "int16")
    high = (np.arange(count) / rate % rig.waveform.sweep_period_s) < rig.waveform.ramp_up_s
    both = np.stack([np.zeros(count), np.where(high, 0.5, -0.5)], axis=1)
    both += 2.0 ** (AUDIO_NOISE_BITS - 16) / 4 * rng.normal(size=both.shape)
    if dtype.kind == "f":
        return np.asarray(both, dtype=dtype)
    return np.asarray(np.rint(both * np.iinfo(dtype).max), dtype=dtype)
