"""Files that a user brings, as targets of random and mutated inputs."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from benchmarks.fuzzing import Target
from benchmarks.stands_radar import RIG
from drivers.records import AudioBlock, Channel, TrolleyFix
from hw_mocks.scene_file import SceneFile
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.matlab import read_matlab
from polfuse_lab.imports.riff import read_wav
from polfuse_lab.plans import parse_plan
from polfuse_lab.records import Sweeps
from polfuse_lab.rig import Rig
from polfuse_lab.rig.toml_model import parse_model
from polfuse_lab.session import open_session
from polfuse_lab.session.layout import TABLES, SessionConfig
from polfuse_lab.session.recovery import recover
from polfuse_lab.session.writer import SessionWriter
from polfuse_lab.simulation.scene_file import SolidSceneFile

_EXAMPLES = Path(__file__).resolve().parent.parent / "polfuse_lab" / "rig" / "examples"
_SCENES = Path(__file__).resolve().parent.parent / "examples" / "scenes"


def _wav() -> bytes:
    """A valid WAV file of 16 stereo frames."""
    samples = bytes(range(64))
    fmt = struct.pack("<4sIHHIIHH", b"fmt ", 16, 1, 2, 48_000, 192_000, 4, 16)
    body = b"WAVE" + fmt + struct.pack("<4sI", b"data", len(samples)) + samples
    return b"RIFF" + struct.pack("<I", len(body)) + body


def file_targets(folder: Path) -> Iterator[Target]:
    """All of them; what is fed goes through files in that folder."""

    def wav(data: bytes) -> None:
        path = folder / "fuzz.wav"
        path.write_bytes(data)
        read_wav(path)

    yield Target("WAV file", wav, (_wav(),), (PolfuseError,), 5)
    for name, model, paths in (
        ("rig file", Rig, [_EXAMPLES / "rig.toml", _EXAMPLES / "rig_by_hand.toml"]),
        ("scene file", SceneFile, [_SCENES / "field.toml", _SCENES / "field_of_bodies.toml"]),
        ("scene file of bodies", SolidSceneFile, [_SCENES / "yard.toml"]),
    ):
        seeds = tuple(path.read_bytes() for path in paths)
        yield Target(name, _toml(model), seeds, (PolfuseError,), 50 if model is Rig else 200)
    plans = tuple(path.read_bytes() for path in sorted(_EXAMPLES.glob("*.toml")) if not path.name.startswith("rig"))
    yield Target("plan file", _plan, plans, (PolfuseError,), 50)

    def matlab(data: bytes) -> None:
        path = folder / "fuzz.mat"
        path.write_bytes(data)
        read_matlab(path)

    yield Target("MATLAB file", matlab, (_matlab(False), _matlab(True)), (PolfuseError,), 5)

    def session(data: bytes) -> None:
        path = folder / "fuzz.h5"
        path.write_bytes(data)
        with open_session(path) as opened:
            for table in TABLES:
                getattr(opened, table)
            for number in range(len(opened.sweeps)):
                opened.audio(number)

    whole = _session(folder)
    yield Target("session file (read)", session, (whole,), (PolfuseError,), 50)
    yield _recovery(folder, whole)


def _matlab(compressed: bool) -> bytes:
    """A MATLAB file of numbers of all kinds, as SciPy writes it."""
    file = io.BytesIO()
    numbers = {"echoes": np.ones((3, 4), np.complex64), "x": np.arange(5.0), "inner": {"count": np.uint8(3)}}
    scipy.io.savemat(file, {"data": numbers, "text": "words"}, do_compression=compressed)
    return file.getvalue()


def _plan(data: bytes) -> None:
    parse_plan(data.decode("utf-8", "replace"), "fuzz.toml")


def _recovery(folder: Path, seed: bytes) -> Target:
    """Whole session files, changed anywhere; each is read by a process of its own."""

    def feed(data: bytes) -> None:
        partial, rescued = folder / "fuzz.h5.partial", folder / "rescued.h5"
        rescued.unlink(missing_ok=True)
        partial.write_bytes(data)
        recover(partial, rescued)

    return Target("session file (recover)", feed, (seed,), (PolfuseError,), 5_000)


def _session(folder: Path) -> bytes:
    """A small session, as its writer leaves it."""
    path = folder / "seed.h5"
    writer = SessionWriter.create(path, SessionConfig("collect", Rig.model_validate(RIG).waveform, 48_000.0))
    samples = np.arange(4000, dtype=np.int16).reshape(-1, 2)
    block = AudioBlock(samples, 48_000.0, 0, 0.0, 1)
    for position in range(3):
        writer.write(Sweeps(block, Channel.HH, position))
        writer.write(TrolleyFix(0.1 * position, 1e-3, False, position))
        writer.flush()
    writer.close("finished", "all steps carried out")
    return path.read_bytes()


def _toml(model: type[Any]) -> Callable[[bytes], None]:
    def feed(data: bytes) -> None:
        parse_model(data.decode("utf-8", "replace"), model, "fuzz.toml")

    return feed
