"""Where GenTL producers (.cti), the libraries that reach cameras, are found on this machine."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Sequence
from pathlib import Path

from drivers.errors import DeviceError, DeviceRefused

ARAVIS = "aravis"
"""What option ``cti`` says for this project's own producer."""
_ARAVIS_FILE = "polfuse-aravis.cti"
_GENTL_PATH = "GENICAM_GENTL64_PATH"
"""The GenTL standard's variable: folders of producers, separated as in PATH."""
_CAMERAS, _INTERFACES = "POLFUSE_GENTL_CAMERAS", "POLFUSE_GENTL_INTERFACE"
"""What the project's own producer reads as it is loaded: whom to ask, and where to broadcast."""


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


def ask_only(addresses: Sequence[str], producer: Path, where: str) -> None:
    """Let the project's producer, once this process loads it, ask these addresses and never broadcast.

    Args:
        addresses: IPv4 addresses of cameras; with none, everything stays as it is.
        producer: the producer that will be loaded.
        where: the device, for the error.

    Raises:
        DeviceRefused: an address that is not one host's, or a producer that cannot be told.
    """
    if not addresses:
        return
    if producer.name != _ARAVIS_FILE:
        raise DeviceRefused(
            f"the GenTL producer {producer.name} cannot be told which addresses to ask",
            where=where,
            advice=f"use cti = {ARAVIS!r}, or leave out option addresses",
        )
    for address in addresses:
        try:
            place = ipaddress.IPv4Address(address)
            wrong = place.is_unspecified or place.is_multicast or int(place) == 0xFFFFFFFF
        except ValueError:
            wrong = True
        if wrong:
            raise DeviceRefused(
                f"option addresses has {address!r}", where=where, advice="give IPv4 addresses such as '192.168.1.20'"
            )
    os.environ[_CAMERAS] = ",".join(addresses)
    os.environ.pop(_INTERFACES, None)
