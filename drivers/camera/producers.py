"""Where GenTL producers (.cti), the libraries that reach cameras, are found on this machine."""

from __future__ import annotations

import os
from pathlib import Path

from drivers.errors import DeviceError

ARAVIS = "aravis"
"""What option ``cti`` says for this project's own producer."""
_ARAVIS_FILE = "polfuse-aravis.cti"
_GENTL_PATH = "GENICAM_GENTL64_PATH"
"""The GenTL standard's variable: folders of producers, separated as in PATH."""


def aravis_producer() -> Path | None:
    """The producer built by ``make gentl``: in a folder of GENICAM_GENTL64_PATH, else in the checkout's build."""
    folders = [Path(folder) for folder in os.environ.get(_GENTL_PATH, "").split(os.pathsep) if folder]
    folders.append(Path(__file__).resolve().parents[2] / "build" / "gentl")
    return next((path for folder in folders if (path := folder / _ARAVIS_FILE).is_file()), None)


def find_producer(cti: str, where: str) -> Path:
    """The producer that a camera's option ``cti`` means.

    Args:
        cti: path of a .cti file; ``"aravis"`` for the project's own; empty for the simulated camera of the genicam
            package.
        where: the device, for the error.

    Raises:
        DeviceError: there is no such file, or the project's own was not built.
    """
    if cti == ARAVIS:
        found = aravis_producer()
        if found is None:
            raise DeviceError(
                f"the GenTL producer {_ARAVIS_FILE} was not found",
                where=where,
                advice=f"build it with 'make gentl', or name its folder in {_GENTL_PATH}",
            )
        return found
    if cti:
        path = Path(cti)
    else:
        import genicam

        path = Path(genicam.__file__).parent / "viky.cti"
    if not path.is_file():
        raise DeviceError(
            f"the GenTL producer {path} does not exist",
            where=where,
            advice="give the .cti file of the camera's vendor in option cti, or 'aravis'",
        )
    return path
