"""Which demosaicer a tolerance asks for: the error of each, foretold from the recorded picture itself.

Errors are root mean square over the four planes, relative to the light behind each angle without noise. A demosaicer's
own error depends on edges, texture and how they are polarized, and that is in the picture: pieces of it are demosaiced
by the most exact way, the result is seen once more through the mosaic, moved on by one row and one column so that every
pixel that was measured is now interpolated, and each demosaicer is asked for what it was given. What detail the first
pass loses is what the second would have lost as well, so that the two all but cancel. Noise is smaller in interpolated
pixels, and so its part in that is taken off and its whole part put in, both in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.optics.demosaic import METHODS, demosaic_by
from processing.optics.mosaic import Mosaic, check_mosaic_image, through_planes
from processing.optics.pieces import spread_pieces
from processing.tolerances import cheapest_within, check_tolerance, reason

Floats = NDArray[np.float64]

COST_NS = {"bilinear": 10.0, "newton": 340.0, "residual": 700.0}
"""Core time of a pixel, ns, on the core that ``polfuse trade`` was first run on; only their order decides."""
SAFETY_DB = 0.5
"""How far below the tolerance the expected error must be: more would keep a few more tolerances, and cost more time
than that is worth."""

NOISE_SHARE = {"bilinear": 9 / 16, "newton": 0.63, "residual": 9 / 16}
"""Variance of white noise in the planes over that of a sample: mean over pixels; bilinear (1 + 1/2 + 1/2 + 1/4) / 4."""
SECOND_SHARE = {"bilinear": 0.253, "newton": 0.313, "residual": 0.253}
"""Variance of what the second pass changes in white noise, over that of a sample; both by Monte Carlo."""

PIECE_PX, PIECES = 64, 12
"""Side of the pieces that are looked at, and how many of them at most, spread over the picture."""
LEAST_PX = 16
"""Smallest side of a picture whose errors can be foretold."""
_BORDER_PX = 4


@dataclass(frozen=True)
class DemosaicChoice:
    """A demosaicer, and why."""

    method: str
    """Of :data:`processing.optics.demosaic.METHODS`."""
    predicted_error_db: float
    """Root mean square over the planes, relative to them, noise included, dB."""
    tolerance_db: float
    kept: bool
    """Whether the tolerance is expected to be kept."""
    noise_db: float
    """What the camera's noise alone leaves in the chosen demosaicer's planes, dB."""
    seconds: float
    """Expected core time."""
    considered: dict[str, float] = field(default_factory=dict)
    """Expected error of each demosaicer, dB, cheapest first."""

    @property
    def reason(self) -> str:
        """In a few words."""
        errors = list(self.considered.values())
        return reason(self.predicted_error_db, errors, self.tolerance_db, kept=self.kept)

    def explain(self) -> list[str]:
        """The choice in words."""
        lines = [
            f"demosaicer {self.method}: {self.reason}; expected error {self.predicted_error_db:.1f} dB, of which the "
            f"camera's noise leaves {self.noise_db:.1f} dB"
        ]
        names = list(self.considered)
        for name in names:
            error = self.considered[name]
            if name == self.method:
                continue
            if names.index(name) > names.index(self.method):
                times = COST_NS[name] / COST_NS[self.method]
                lines.append(f"not {name}: takes {times:.3g} times as long ({error:.1f} dB)")
            else:
                lines.append(f"not {name}: {error:.1f} dB")
        return lines


def demosaic_errors_db(image: NDArray[np.generic], mosaic: Mosaic, variance: ArrayLike = 0.0) -> dict[str, float]:
    """Expected error of each demosaicer, dB; with the name ``"noise"`` before each what noise alone leaves in it.

    Args:
        image: (rows, columns) counts above black, NaN where undefined.
        mosaic: polarizers on the pixels.
        variance: of the image's noise, counts^2; a number, or (rows, columns).

    Returns:
        Keys of :data:`processing.optics.demosaic.METHODS`, and ``"noise bilinear"`` and so on.

    Raises:
        DataError: not an image of even size, a smaller one than :data:`LEAST_PX`, or without light.
    """
    check_mosaic_image(image, least=LEAST_PX)
    values = np.asarray(image, dtype=np.float64)
    noise = np.broadcast_to(np.asarray(variance, dtype=np.float64), values.shape)
    again = mosaic.shifted(1, 1)
    squares = dict.fromkeys(METHODS, 0.0)
    power = own = 0.0
    count = 0
    for window in spread_pieces(values.shape, PIECE_PX, PIECES):
        piece = values[window]
        planes = demosaic_by("residual", piece, mosaic).astype(np.float64)
        seen = through_planes(planes, again)
        inner = (..., slice(_BORDER_PX, -_BORDER_PX), slice(_BORDER_PX, -_BORDER_PX))
        changes = {name: (demosaic_by(name, seen, again) - planes)[inner] for name in METHODS}
        defined = np.isfinite(planes[inner]).all(axis=0)
        for change in changes.values():
            defined &= np.isfinite(change).all(axis=0)
        if not defined.any():
            continue
        for name, change in changes.items():
            squares[name] += float((change[:, defined] ** 2).sum())
        power += float((planes[inner][:, defined] ** 2).sum())
        spread = noise[window][inner][defined]
        own += len(planes) * float(spread[np.isfinite(spread)].sum())
        count += int(defined.sum())
    power -= NOISE_SHARE["residual"] * own
    if not count or not power > 0:
        raise DataError("no demosaicer's error can be foretold of a picture without light", "check the frames")
    errors = {}
    for name in METHODS:
        detail = max(squares[name] - SECOND_SHARE[name] * own, 0.0)
        left = NOISE_SHARE[name] * own
        errors[name] = _db((detail + left) / power)
        errors[f"noise {name}"] = _db(left / power)
    return errors


def choose_demosaicer(
    image: NDArray[np.generic], mosaic: Mosaic, tolerance_db: float, *, variance: ArrayLike = 0.0
) -> DemosaicChoice:
    """The fastest demosaicer whose expected error is within the tolerance; where there is none, the best of them.

    Args:
        image, mosaic, variance: as for :func:`demosaic_errors_db`.
        tolerance_db: largest error, dB (negative).

    Raises:
        DataError: a tolerance that is no negative number, and as :func:`demosaic_errors_db`.
    """
    check_tolerance(tolerance_db, "light")
    errors = demosaic_errors_db(image, mosaic, variance)
    order = sorted(METHODS, key=COST_NS.__getitem__)
    considered = {name: errors[name] for name in order}
    method = order[cheapest_within([errors[name] for name in order], tolerance_db, SAFETY_DB)]
    return DemosaicChoice(
        method=method,
        predicted_error_db=errors[method],
        tolerance_db=tolerance_db,
        kept=errors[method] <= tolerance_db,
        noise_db=errors[f"noise {method}"],
        seconds=1e-9 * COST_NS[method] * np.asarray(image).size,
        considered=considered,
    )


def _db(square: float) -> float:
    return 10 * math.log10(max(square, 1e-32))
