"""What others make of PolSARpro folders that this program wrote, and of the pictures that PolSARpro made.

polsartools opens the folders by its own commands, in a process of its own, as its users do.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row
from polfuse_lab.exports.polsarpro import Matrix, export_polsarpro
from polfuse_lab.imports.polsarpro import STAGE
from polfuse_lab.polsarpro import plane_names, read_plane
from polfuse_lab.products.store import Products
from processing.polarimetry.averaging import window_average
from processing.polarimetry.freeman import freeman_durden
from processing.polarimetry.matrices import planes_of_vector
from processing.polarimetry.pauli import pauli_vector

Values = NDArray[Any]

AGREED = 1e-5
"""Largest deviation of what a peer reads or makes of a folder, of the span: float32 sums in another order."""
RANKED = 0.999
_FREEMAN = "import sys, polsartools as p; p.freeman_3c(sys.argv[1], win={window}, fmt='bin', max_workers=1)"
_CONVERT = "import sys, polsartools as p; p.convert_S(sys.argv[1], 'T3', azlks=1, rglks=1, fmt='bin', max_workers=1)"


def opened(planes: Values, window: int) -> list[Row]:
    """polsartools on a T3, a C3 and an S2 folder of ours, against this program's own result from the same matrices.

    Args:
        planes: (9, rows, columns) float32 coherency planes; the S2 folder is speckle of the same size.
        window: of the average before the decomposition, pixels.
    """
    size = planes.shape[1:]
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _products(folder / "T3.h5", "T3", planes)
        powers = freeman_durden(window_average(planes, window))
        for matrix in ("T3", "C3"):
            export_polsarpro(folder / "T3.h5", folder / matrix, matrix)
            made = _peer(_FREEMAN.format(window=window), folder / matrix)
            inner = (slice(None), slice(window, -window), slice(window, -window))
            names = [f"Freeman_3c_{power}" for power in ("odd", "dbl", "vol")]
            rows.append(_row(matrix, "freeman_3c", made, folder / matrix, names, powers, size, inner))
        rng = np.random.default_rng(4)
        s = (rng.normal(size=(4, *size)) + 1j * rng.normal(size=(4, *size))).astype(np.complex64)
        s[2] = s[1]
        _products(folder / "S2.h5", "S2", s)
        export_polsarpro(folder / "S2.h5", folder / "S2", "S2")
        made = _peer(_CONVERT, folder / "S2")
        t = planes_of_vector(pauli_vector(s[0], s[1], s[3]).astype(np.complex64))
        everywhere = (slice(None), slice(None), slice(None))
        rows.append(_row("S2", "convert_S", made, folder / "S2" / "T3", list(plane_names("T3")), t, size, everywhere))
    return rows


def pictures(folder: Path, planes: Values) -> list[Row]:
    """Freeman's powers of the whole image against PolSARpro's pictures of them, ``Ps.bmp``, ``Pd.bmp`` and ``Pv.bmp``.

    The pictures are grey levels of decibels on a scale of their own, so ranks are compared, where a picture is neither
    black nor white. They were made with a 3 x 3 average.
    """
    from PIL import Image
    from scipy.stats import spearmanr

    powers = freeman_durden(window_average(planes, 3))
    rows = []
    for power, name in zip(powers, ("Ps", "Pd", "Pv"), strict=True):
        path = folder / f"{name}.bmp"
        if not path.exists():
            rows.append(Row(f"decompositions.picture_{name}", "PolSARpro", None, True, f"{path.name} is not present"))
            continue
        with Image.open(path) as image:
            grey = np.asarray(image.convert("L"))[: power.shape[0]].astype(float)
        shown = (grey > 0) & (grey < 255) & (power > 0)
        shown[:2] = shown[-2:] = shown[:, :2] = shown[:, -2:] = False
        rank = float(spearmanr(grey[shown], power[shown]).statistic)
        words = f"rank correlation {rank:.5f} over {int(shown.sum())} pixels"
        target = f"rank correlation above {RANKED}"
        rows.append(Row(f"decompositions.picture_{name}", "PolSARpro", None, rank > RANKED, target, error=words))
    return rows


def _products(path: Path, matrix: Matrix, planes: Values) -> None:
    names = list(plane_names(matrix)) if matrix != "S2" else ["HH", "HV", "VH", "VV"]
    units = {"planes": "sqrt(m^2)" if matrix == "S2" else "m^2"}
    settings = {"matrix": matrix, "planes": names}
    Products(path).write(STAGE, {"planes": planes}, settings=settings, inputs=[], units=units)


def _peer(code: str, folder: Path) -> str:
    """Run polsartools; what it complained of, empty when it ended well."""
    done = subprocess.run([sys.executable, "-c", code, str(folder)], capture_output=True, text=True, timeout=300)
    return "" if done.returncode == 0 else json.dumps(done.stderr.strip().splitlines()[-1:])


def _row(
    matrix: str, command: str, complaint: str, folder: Path, names: list[str], truth: Values,
    size: tuple[int, ...], kept: tuple[slice, ...],
) -> Row:  # fmt: skip
    label, target = f"decompositions.opens_{matrix}", f"{command} reads our folder; within {AGREED:g} of the span"
    if complaint:
        return Row(label, "polsartools", None, False, target, error=complaint)
    found = np.stack([read_plane(folder, name, *size) for name in names])
    # Freeman's three powers sum to the span; of coherency planes the diagonal does.
    span = truth.sum(axis=0) if len(truth) == 3 else truth[0] + truth[5] + truth[8]
    deviation = (np.abs(found - truth) / span)[kept]
    worst = float(np.nanmax(deviation))
    words = f"largest {worst:.1e} in {np.isfinite(deviation).mean():.1%} of the pixels"
    return Row(label, "polsartools", None, worst < AGREED, target, error=words)
