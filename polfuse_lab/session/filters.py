"""What audio and images of a session may be stored with: filters of HDF5, all of them lossless."""

from __future__ import annotations

from typing import Any

import hdf5plugin

from polfuse_lab.errors import PolfuseError

FILTERS: dict[str, dict[str, Any]] = {
    "none": {},
    "bitshuffle-lz4": dict(hdf5plugin.Bitshuffle(cname="lz4")),
    "bitshuffle-zstd": dict(hdf5plugin.Bitshuffle(cname="zstd")),
}
"""Options of a dataset by the filter's name, fastest first. Each is one filter at most, so that a writer that falls
behind can leave it out for single chunks (:mod:`polfuse_lab.session.growing`)."""
USUAL = "bitshuffle-lz4"


def options(name: str) -> dict[str, Any]:
    """Options of a dataset.

    Raises:
        PolfuseError: there is no filter of that name.
    """
    if name not in FILTERS:
        raise PolfuseError(f"there is no filter {name!r}", where="session", advice=f"choose from {', '.join(FILTERS)}")
    return FILTERS[name]
