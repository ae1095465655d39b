"""Which benchmarks compare with other people's programs, and what they found, as one table."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Sequence

from benchmarks.rows import Row

PEERS = (
    "accuracy.dot_motion",
    "accuracy.raytrace",
    "accuracy.speckle",
    "reliability.gige",
    "speed.backprojection",
    "speed.decompositions",
    "speed.factorized",
    "speed.mosaic",
    "speed.range_migration",
    "speed.raytrace",
    "speed.speckle",
)
"""Benchmarks with a row that names a program of :data:`PROGRAMS`. A program that is missing is told, not compared."""

PROGRAMS = {
    "Aravis": None,
    "Mitsuba": "mitsuba",
    "PolSARpro": None,
    "SciPy": "scipy",
    "embreex": "embreex",
    "fastsar": "fastsar",
    "polanalyser": "polanalyser",
    "polsartools": "polsartools",
    "scikit-image": "scikit-image",
    "torchbp": "torchbp",
}
"""Other people's programs by the word that rows call them, and their distributions where pip installs them."""


def program(row: Row) -> str | None:
    """The program that a row compares with; None where it compares with a limit, a closed form or ourselves."""
    return next((name for name in PROGRAMS if name in row.peer), None)


def peer_rows(rows: Sequence[Row]) -> list[Row]:
    """Rows that compare with a program of somebody else's."""
    return [row for row in rows if program(row)]


def table(rows: Sequence[Row]) -> str:
    """Those rows as a Markdown table: what, with whom, ratio (how it is meant is told beside it), errors of both."""
    lines = ["| what | peer | ratio | our error | the peer's | what is asked for |", "|---|---|---|---|---|---|"]
    for row in peer_rows(rows):
        ratio = "" if row.ratio is None else f"{row.ratio:.3g}"
        if row.ratio_min is not None and row.ratio_max is not None:
            ratio += f" ({row.ratio_min:.3g} to {row.ratio_max:.3g})"
        cells = (row.name, _with_version(row), ratio, _told(row.error), _told(row.peer_error), row.target)
        lines.append("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")
    return "\n".join(lines)


def _with_version(row: Row) -> str:
    name = program(row)
    distribution = PROGRAMS[name] if name else None
    if distribution is None:
        return row.peer
    try:
        return f"{row.peer}, {distribution} {importlib.metadata.version(distribution)}"
    except importlib.metadata.PackageNotFoundError:
        return f"{row.peer} (not installed)"


def _told(error: float | str | None) -> str:
    return "" if error is None else error if isinstance(error, str) else f"{error:.3g}"
