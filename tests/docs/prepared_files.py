"""Files that the documentation's code finds: a small session of a rail and a camera, as a demo leaves one behind."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

_TESTS = Path(__file__).resolve().parents[1]
sys.path.extend([str(_TESTS / "sar"), str(_TESTS / "optics")])

from optics_session import RIG as OPTICS_RIG  # noqa: E402
from optics_session import SCENE, series  # noqa: E402
from rail_data import BANDWIDTH_HZ, CENTRE_HZ, HEIGHT_M  # noqa: E402
from rail_session import RATE_HZ, RIG, samples  # noqa: E402
from test_moving_pass import pass_session  # noqa: E402

from drivers.records import AudioBlock, Channel, TrolleyFix  # noqa: E402
from polfuse_lab.records import Sweeps  # noqa: E402
from polfuse_lab.rig import Waveform  # noqa: E402
from polfuse_lab.session import SessionConfig, SessionWriter  # noqa: E402

TARGETS = [
    ((1.2, 8.6, 0.469 - HEIGHT_M), np.array([[1, 0.01], [0.01, 1]]) * 13.2),  # the demo's trihedral
    ((-1.8, 11.2, 0.319 - HEIGHT_M), np.array([[1, 0], [0, -1]]) * 8.0),
]
POSITIONS = (np.arange(11) - 5) * 0.0508
CAMERA = OPTICS_RIG[OPTICS_RIG.index("[camera]") :]


def session(path: Path) -> Path:
    """Four channels at eleven positions, and two frames at each of four angles of the polarizer."""
    path.parent.mkdir(exist_ok=True)
    scene = path.with_suffix(".scene.toml")
    scene.write_text(SCENE, encoding="utf-8")
    exposures = series(scene, (0.0, 45.0, 90.0, 135.0), 2)
    waveform = Waveform(centre_hz=CENTRE_HZ, bandwidth_hz=BANDWIDTH_HZ, ramp_up_s=0.02, sweep_period_s=0.04)
    shape = exposures[0].frame.image.shape
    config = SessionConfig(
        "collect", waveform, RATE_HZ, frame_shape=(shape[0], shape[1]), sample_dtype="float32", rig_toml=RIG + CAMERA
    )
    noise = np.random.default_rng(1)
    with SessionWriter.create(path, config, ballast_bytes=0) as writer:
        for position, x in enumerate(POSITIONS):
            writer.write(TrolleyFix(float(x), 1e-4, False, position * 1_000_000, "stop"))
            for channel in Channel:
                beat = samples(x, TARGETS, channel)
                beat[:, 0] += noise.normal(0, 1e-4, len(beat)).astype(np.float32)
                block = AudioBlock(beat, RATE_HZ, 0, 0.0, position * 1_000_000)
                writer.write(Sweeps(block, channel, position, x_m=float(x), sweeps_requested=2))
        for exposure in exposures:
            writer.write(replace(exposure))
    return path


def prepare(page: str, folder: Path, made_session: Callable[[], Path]) -> None:
    """Put into a folder what the code of a page asks for.

    Args:
        page: relative to the repository.
        folder: where its code runs.
        made_session: gives the session, made once for all pages.
    """
    for needs, name in SESSIONS.items():
        if page == needs:
            for copy in name:
                (folder / copy).parent.mkdir(exist_ok=True)
                shutil.copyfile(made_session(), folder / copy)
    if page == "docs/session-file.md":
        pass_session(folder / "run.h5", 0.4, 1.0)


SESSIONS = {
    "README.md": ("day1.h5",),
    "docs/session-file.md": ("day1.h5",),
    "docs/tutorial.md": ("demo_out/session.h5",),
}
"""Pages whose code reads a session, and where they look for it."""
