"""Does the radar find the scene's targets: where they are, how strong, how sharp, how pure? Truth is the scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.products.calibrate import CalibrationResult
from polfuse_lab.products.calibration_inputs import FocusedImage, TargetSpec, read_focused
from polfuse_lab.products.checks import Check
from polfuse_lab.products.store import Products
from processing.sar.grid import ImageGrid
from processing.sar.quality import Peak, complex_correlation, point_response, refine_peak
from processing.sar.resolution import Resolution, point_resolution
from processing.scene.model import Reflector, Scene, Vector

CO = ("HH", "VV")


class Target(NamedTuple):
    """A point-like target of the scene and where a focused image on the ground plane shows it."""

    name: str
    position_m: Vector
    x_m: float
    y_m: float


def target_spec(reflector: Reflector, ground_z_m: float) -> TargetSpec:
    """What the owner of a reflector would state of it."""
    x, y, z = reflector.position_m
    return TargetSpec(
        kind=reflector.kind,
        x_m=x,
        y_m=y,
        edge_m=reflector.edge_m,
        azimuth_rad=reflector.azimuth_rad,
        elevation_rad=reflector.elevation_rad,
        fold_rad=reflector.fold_rad,
        height_m=z - ground_z_m,
    )


def targets(scene: Scene, ground_z_m: float) -> Iterator[Target]:
    """Points and reflectors of a scene; what stands above the ground lays over towards the rail."""
    named = [(item.name, item.position_m) for item in scene.points]
    named += [(item.name, item.position_m) for item in scene.reflectors]
    for name, (x, y, z) in named:
        yield Target(name, (x, y, z), x, math.sqrt(y**2 + z**2 - ground_z_m**2))


def place_checks(products_path: Path | str, scene: Scene) -> list[Check]:
    """Each target's peak against its true place, in resolution cells: the larger of the offsets in x and in y."""
    focused = read_focused(Products(products_path))
    checks = []
    for target in targets(scene, focused.z_m):
        cell = _resolution(focused, target)
        peak = _peak(focused, target, cell)
        offset = max(abs(peak.x_m - target.x_m) / cell.x_m, abs(peak.y_m - target.y_m) / cell.y_m)
        checks.append(
            Check(
                f"place_{target.name.replace(' ', '_')}",
                offset,
                0.0,
                0.5,
                "cell",
                f"Found at ({peak.x_m:.2f}, {peak.y_m:.2f}) m, stands at ({target.x_m:.2f}, {target.y_m:.2f}) m on the "
                f"ground plane; a cell is {cell.x_m:.2f} m by {cell.y_m:.2f} m.",
            )
        )
    return checks


def resolution_checks(products_path: Path | str, scene: Scene) -> list[Check]:
    """−3 dB widths of the first isolated point against the exact theory of this track and these windows."""
    focused = read_focused(Products(products_path))
    target = next(targets(scene, focused.z_m))
    cell = _resolution(focused, target)
    response = point_response(
        _hh(focused),
        _grid(focused),
        target.x_m,
        target.y_m,
        reach_m=(cell.x_m, cell.y_m),
        range_compensated=True,
    )
    return [
        Check(
            f"resolution_{name}",
            width,
            theory,
            0.1 * theory,
            "m",
            f"−3 dB width of the {target.name} along {axis}, against theory for this track and window.",
        )
        for name, axis, width, theory in (
            ("cross_range", "x", response.x.width_m, cell.x_m),
            ("range", "y", response.y.width_m, cell.y_m),
        )
    ]


def calibration_checks(result: CalibrationResult, scene: Scene) -> list[Check]:
    """The dihedral's RCS after calibration on the trihedral; isolation and imbalance against the scene's front end."""
    m = scene.front_end.receive @ scene.front_end.transmit
    checks = []
    if result.check is not None:
        checks.append(
            Check(
                "dihedral_rcs",
                result.check.rcs_dbsm,
                result.check.expected_dbsm,
                1.0,
                "dBsm",
                f"Dihedral ({result.check.channel}) after calibration on the trihedral; expected from its size and "
                "angles, averaged over the aperture.",
            )
        )
    # Transmit H is column 0; the trihedral's S is a multiple of the identity.
    truth = {"HV": abs(m[1, 0] / m[0, 0]), "VH": abs(m[0, 1] / m[1, 1])}
    for channel, found in sorted(result.crosstalk_db.items()):
        checks.append(
            Check(
                f"isolation_{channel.lower()}",
                found,
                20 * math.log10(truth[channel]),
                1.0,
                "dB",
                f"Cross over co-polarized return of the trihedral in {channel}, against the scene's front end.",
            )
        )
    balance = m[1, 1] / m[0, 0]
    checks += [
        Check(
            "imbalance_db",
            result.imbalance_db,
            20 * math.log10(abs(balance)),
            0.3,
            "dB",
            "VV over HH of the trihedral, against the scene's front end.",
        ),
        Check(
            "imbalance_deg",
            result.imbalance_deg,
            math.degrees(np.angle(balance)),
            2.0,
            "°",
            "Phase of VV against HH of the trihedral, against the scene's front end.",
        ),
    ]
    return checks


def method_checks(products_path: Path | str, other_path: Path | str, scene: Scene) -> list[Check]:
    """Two focusing methods on one session: peaks in cells apart, and correlation in the common support."""
    first, second = read_focused(Products(products_path)), read_focused(Products(other_path))
    apart = 0.0
    for target in targets(scene, first.z_m):
        cell = _resolution(first, target)
        one, two = (_peak(image, target, cell) for image in (first, second))
        apart = max(apart, abs(one.x_m - two.x_m) / cell.x_m, abs(one.y_m - two.y_m) / cell.y_m)
    alike = min(
        abs(complex_correlation(first.image[first.channels.index(name)], second.image[second.channels.index(name)]))
        for name in CO
    )
    return [
        Check(
            "rma_peaks",
            apart,
            0.0,
            0.1,
            "cell",
            "Largest distance between a target's peaks after range migration and after back-projection.",
        ),
        Check(
            "rma_correlation",
            alike,
            1.0,
            0.01,
            "",
            "Complex correlation of the range-migration and back-projection images where both are defined (the worse "
            "of HH and VV).",
            sense="at_least",
        ),
    ]


def _grid(focused: FocusedImage) -> ImageGrid:
    return ImageGrid(focused.x_m, focused.y_m, focused.z_m)


def _resolution(focused: FocusedImage, target: Target) -> Resolution:
    place = np.array(target.position_m)
    return point_resolution(
        focused.antenna_m,
        target.position_m,
        centre_hz=focused.centre_hz,
        bandwidth_hz=focused.bandwidth_hz,
        window=str(focused.ranging["window"]),
        aperture_weights=focused.pulse_weights(place),
    )


def _peak(focused: FocusedImage, target: Target, cell: Resolution) -> Peak:
    """The target's peak between the pixels: from the strongest pixel within one cell of where it should be."""
    grid, image = _grid(focused), _hh(focused) / focused.range_gain
    near = (np.abs(grid.y_m - target.y_m)[:, None] <= cell.y_m) & (np.abs(grid.x_m - target.x_m) <= cell.x_m)
    level = np.where(near & np.isfinite(image), np.abs(image), 0.0)
    row, column = np.unravel_index(int(level.argmax()), level.shape)
    return refine_peak(image, grid, int(row), int(column))


def _hh(focused: FocusedImage) -> NDArray[np.complexfloating]:
    image: NDArray[np.complexfloating] = focused.image[focused.channels.index("HH")]
    return image
