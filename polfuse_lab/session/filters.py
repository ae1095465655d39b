"""What audio and images of a session may be stored with: filters of HDF5, all of them lossless.

Behind each chunk stands a checksum of what is stored. It tells damage which nobody would see in samples, and it is
looked at before a chunk is decompressed: bitshuffle's LZ4 believes what it reads, and without a checksum it ended the
process in 7 % of the files with a few wrong bytes.
"""

from __future__ import annotations

from typing import Any

import hdf5plugin

from polfuse_lab.errors import PolfuseError

FILTERS: dict[str, dict[str, Any]] = {
    "none": {"fletcher32": True},
    "bitshuffle-lz4": {**hdf5plugin.Bitshuffle(cname="lz4"), "fletcher32": True},
    "bitshuffle-zstd": {**hdf5plugin.Bitshuffle(cname="zstd"), "fletcher32": True},
}
"""Options of a dataset by the filter's name, fastest first. Each compresses once at most, so that a writer that falls
behind can leave that out for single chunks (:mod:`polfuse_lab.session.growing`)."""
USUAL = "bitshuffle-lz4"


def options(name: str) -> dict[str, Any]:
    """Options of a dataset.

    Raises:
        PolfuseError: there is no filter of that name.
    """
    if name not in FILTERS:
        raise PolfuseError(f"there is no filter {name!r}", where="session", advice=f"choose from {', '.join(FILTERS)}")
    return FILTERS[name]
