"""Images larger than memory: what tiles cost in time and in memory, and whether their bits are the same."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rows import Row

LIMIT_BYTES = 700_000_000
POSITIONS = 16
RATE_HZ, RAMP, PERIOD = 48_000.0, 960, 1920

RIG = """
name = "rail"
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 8e7
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = 1.0
antenna_elevation_deg = 17.0
beamwidth_deg = 70.0
[radar]
driver = "sounddevice"
[switches]
driver = "dowkey_ms"
[trolley]
driver = "by_hand"
length_m = 3.2
"""


def _session(path: Path) -> Path:
    """Noise in four channels at places along a rail: every bit of the image depends on order and rounding."""
    from drivers.records import AudioBlock, Channel
    from polfuse_lab.records import Sweeps
    from polfuse_lab.rig import Waveform
    from polfuse_lab.session import SessionConfig, SessionWriter

    rng = np.random.default_rng(0)
    waveform = Waveform(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.02, sweep_period_s=0.04)
    config = SessionConfig("collect", waveform, RATE_HZ, sample_dtype="float32", rig_toml=RIG, plan_toml=None)
    sync = np.where(np.mod(np.arange(6000) - 300, PERIOD) < RAMP, 0.8, -0.8)
    with SessionWriter.create(path, config, ballast_bytes=0) as writer:
        for position in range(POSITIONS):
            for channel in Channel:
                beat = 0.2 * rng.standard_normal(len(sync))
                block = AudioBlock(np.stack([beat, sync], axis=1).astype(np.float32), RATE_HZ, 0, 0.0, position * 1000)
                x = (position - POSITIONS / 2) * 0.0508
                writer.write(Sweeps(block, channel, position, x_m=x, sweeps_requested=2))
    return path


def _run(session: Path, products: Path, pixels: int, *options: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.scale_worker", str(session), str(products), "--pixels", str(pixels)]
    done = subprocess.run([*command, *options], capture_output=True, text=True, timeout=3600, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr)
    told: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return told


def run(quick: bool) -> list[Row]:
    """Focus one session in one piece, in tiles within a limit of memory, and in tiles on two processes."""
    from polfuse_lab.products.store import Products

    # 4 channels of 8 bytes: an image of 128 MB, or of 1.15 GB.
    pixels = 2000 if quick else 6000
    with tempfile.TemporaryDirectory() as folder:
        session = _session(Path(folder) / "session.h5")
        paths = [Path(folder) / f"{name}.h5" for name in ("one", "tiles", "dask")]
        one = _run(session, paths[0], pixels)
        tiled = _run(session, paths[1], pixels, "--memory", str(LIMIT_BYTES))
        spread = None
        if importlib.util.find_spec("distributed") is not None:
            spread = _run(session, paths[2], pixels, "--workers", "2")
        stages = [Products(path) for path in paths if path.exists()]
        image_bytes = 8 * one["channels"] * pixels**2
        arrays = stages[0].read("ranging")["profiles"].nbytes + image_bytes
        digests = [[products.provenance(stage)["sha256"] for stage in ("ranging", "focus")] for products in stages]
    in_one = (one["peak"] - one["before"]) / arrays
    rows = [
        Row(
            "memory of focusing in one piece", "image + profiles", in_one, in_one < 3, "below 3 times",
            error=f"{arrays / 1e6:.0f} MB of image and profiles",
        ),
        Row(
            "memory of focusing in tiles", "the limit", tiled["peak"] / LIMIT_BYTES, tiled["peak"] <= LIMIT_BYTES,
            "within the limit", error=f"{image_bytes / 1e6:.0f} MB of image, limit {LIMIT_BYTES / 1e6:.0f} MB",
        ),
        Row(
            "time of focusing in tiles", "one piece", tiled["seconds"] / one["seconds"],
            tiled["seconds"] < 1.5 * one["seconds"], "below 1.5 times",
        ),
        Row(
            "bits of focusing in tiles", "one piece", None, digests[1] == digests[0], "the same",
            error="none differ" if digests[1] == digests[0] else "some differ",
        ),
    ]  # fmt: skip
    if spread is None:
        rows.append(Row("bits of tiles on Dask", "one piece", None, True, "the same", error="skipped: no extra 'dask'"))
    else:
        same = digests[2] == digests[0]
        told = f"{spread['seconds'] / one['seconds']:.2f} times its time, two processes"
        rows.append(Row("bits of tiles on Dask", "one piece", None, same, "the same", error=told))
    return rows
