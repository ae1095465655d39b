"""Session files as version 1 wrote them, for tests: its layout is frozen here, apart from the package's own."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np

TABLES = {
    "frames": np.dtype(
        [("angle_rad", "f8"), ("angle_sd_rad", "f8"), ("exposure_s", "f8"), ("gain_db", "f8"), ("frame_id", "i8"),
         ("t_host_ns", "i8"), ("t_device_s", "f8"), ("incomplete", "?"), ("dark", "?"), ("lost_before", "i4"),
         ("attempt", "i4")]),
    "trolley": np.dtype([("x_m", "f8"), ("sd_m", "f8"), ("moving", "?"), ("t_host_ns", "i8"), ("state", "S32")]),
    "switches": np.dtype([("transmit", "S4"), ("receive", "S4"), ("verified", "?"), ("t_host_ns", "i8")]),
    "polarizer": np.dtype([("angle_rad", "f8"), ("sd_rad", "f8"), ("moving", "?"), ("t_host_ns", "i8")]),
}  # fmt: skip
"""Tables that have changed since; all others are as they were."""


def to_version_1(path: Path) -> None:
    """Rewrite a session file as version 1 would have written it: without looks during records, or its steps."""
    with h5py.File(path, "r+", libver=("v110", "v110")) as file:
        for name, dtype in TABLES.items():
            rows = file[name][:]
            if "record" in rows.dtype.names:
                rows = rows[rows["record"] == -1]
            old = np.zeros(len(rows), dtype)
            for column in dtype.names or ():
                old[column] = rows[column]
            del file[name]
            file.create_dataset(name, data=old, maxshape=(None,), chunks=(256,))
        del file["source_polarizer"]
        config = json.loads(bytes(file["config"][:]))
        config["extra"].pop("steps", None)
        del file["config"]
        file.create_dataset("config", data=np.frombuffer(json.dumps(config).encode(), np.uint8))
        file.attrs["version"] = 1
