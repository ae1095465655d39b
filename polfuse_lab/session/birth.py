"""The file of a session before its first record and after its last: how it gets its name, and keeps it."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import h5py
import numpy as np

from polfuse_lab.session import layout
from polfuse_lab.session.layout import SessionConfig
from polfuse_lab.session.naming import partial_path, rename_without_replacing, unborn_path
from polfuse_lab.session.space import ballast_path, in_use

BOUNDS = ("v110", "v110")
"""Of HDF5 1.10: the first that knows single writers with readers, and the one that most other programs can read."""


def declare(unborn: Path, partial: Path, config: SessionConfig) -> h5py.File:
    """Declare everything, and only then give the file its name: one killed before that cannot be opened."""
    if os.name == "nt":
        unborn = partial  # open files cannot be renamed there
    else:
        # A writer killed here may have left one; the ballast's lock says that none is at it now.
        unborn.unlink(missing_ok=True)
    file = h5py.File(unborn, "x", libver=BOUNDS)
    try:
        file.attrs["schema"] = layout.SCHEMA
        file.attrs["version"] = layout.VERSION
        file.create_dataset("config", data=np.frombuffer(layout.snapshot(config), dtype=np.uint8))
        state = np.zeros(1, layout.STATE)
        state["state"] = b"recording"
        file.create_dataset("state", data=state)
        layout.declare_audio(file, config.audio_channels, config.sample_dtype, config.chunk_frames, config.filter)
        if config.frame_shape is not None:
            layout.declare_images(file, config.frame_shape, config.frame_dtype, config.filter)
        for name in layout.TABLES:
            layout.declare_table(file, name)
        file.flush()
        file.swmr_mode = True
        if unborn != partial:
            rename_without_replacing(unborn, partial)
    except BaseException:
        file.close()
        unborn.unlink(missing_ok=True)
        raise
    return file


def discard_unborn(path: Path) -> None:
    """Remove what a writer that was killed before its session had begun left; one that has begun is left alone."""
    if partial_path(path).exists() or in_use(ballast_path(path)):
        return
    for left in (unborn_path(path), ballast_path(path)):
        with contextlib.suppress(OSError):
            left.unlink(missing_ok=True)


def write_again(handle: int, path: Path) -> None:
    """Write a file whose name has been deleted, and which is still open, to its place again. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "xb") as file:
        place = 0
        while piece := os.pread(handle, 1 << 20, place):
            place += file.write(piece)
        file.flush()
        os.fsync(file.fileno())
