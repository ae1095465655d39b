"""Sessions of older schema versions, read as if they were of the present one.

A version only ever adds: tables, and fields at the end of a table's rows. So one rule reads every older file: what it
does not have yet is filled with what was true then (:data:`BEFORE`), or else with "not known".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.session import layout

BEFORE: Mapping[tuple[str, str], Any] = {
    (table, "record"): layout.UNASKED for table in ("trolley", "switches", "polarizer", "source_polarizer")
}
"""(table, field) that came with a later version: its value in older files, where it is not simply unknown."""

ADDED_TABLES = ("source_polarizer",)
"""Tables that came with a later version; a file without any other one is damaged."""


def absent(table: str, field: str) -> Any:
    """What stands for a field in files that do not have it: of :data:`BEFORE`, else NaN, 0, False or empty text."""
    if (table, field) in BEFORE:
        return BEFORE[table, field]
    dtype = layout.TABLES[table].fields[field][0]  # type: ignore[index]
    return np.nan if dtype.kind in "fc" else np.zeros((), dtype)[()]


def upgraded(table: str, rows: NDArray[np.void]) -> NDArray[np.void]:
    """Rows of a table as the present version has them: (n,) of ``layout.TABLES[table]``.

    Fields that the present version does not know are left out.
    """
    dtype = layout.TABLES[table]
    if rows.dtype == dtype:
        return rows
    found = np.zeros(len(rows), dtype)
    have = set(rows.dtype.names or ())
    for field in dtype.names or ():
        found[field] = rows[field] if field in have else absent(table, field)
    return found


def missing_table(table: str) -> NDArray[np.void]:
    """The empty table that stands for one which an older file does not have."""
    return np.zeros(0, layout.TABLES[table])
