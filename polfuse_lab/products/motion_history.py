"""Moving targets of a phase history in a NumPy file (.npz) or of a simulated scene, and an example of one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.store import Products, is_products
from processing.motion.estimate import EstimateSettings
from processing.motion.prediction import Ambiguities, Passage, ambiguities
from processing.motion.radon import RadonSettings
from processing.motion.search import Found, find_moving
from processing.radar.phase_history import PhaseHistory, history_profiles
from processing.sar.grid import ImageGrid

Floats = NDArray[np.float64]

STAGE = "moving"
TOLD = (
    "x_m", "y_m", "azimuth_m_s", "azimuth_sd_m_s", "ground_m_s", "ground_sd_m_s", "slant_m_s", "slant_sd_m_s",
    "shift_m", "snr_db",
)  # fmt: skip
"""What is told of each target."""
NEEDED = ("echoes", "first_hz", "step_hz", "antenna_m", "reference_m", "time_s", "beamwidth_rad", "z_m")
"""What the file holds: echoes (pulses, frequencies), places (pulses, 3), references and times (pulses,), and
numbers."""
_LARGEST_PIXELS = 2_000_000
_SWATH = 0.47
"""Part of the unambiguous swath on either side of its middle in which interpolation finds its bins."""


@dataclass(frozen=True)
class HistoryResult:
    """Targets, where they were looked for, and what the collect cannot tell."""

    found: Found
    grid: ImageGrid
    """Below the track: y is the ground range from it."""
    ambiguities: Ambiguities
    track_y_m: float = 0.0
    """Where the track runs in the file's coordinates: to be added to y."""

    def targets(self) -> list[dict[str, float]]:
        """Places and velocities in the file's coordinates, the most evident first."""
        told = [{name: float(getattr(target, name)) for name in TOLD} for target in self.found.targets]
        return [{**target, "y_m": target["y_m"] + self.track_y_m} for target in told]


def write_targets(result: HistoryResult, products_path: Path | str, source: Path | str) -> None:
    """Write the stage "moving": ``power`` of the picture of what stands, ``x_m``, ``y_m``; settings ``targets``, each
    with where its streak is (``streak_x_m``, ``streak_y_m``).

    Raises:
        PolfuseError: the products file cannot be written.
    """
    grid, found = result.grid, result.found
    y = grid.y_m + result.track_y_m
    streaks = [
        {
            "streak_x_m": float(np.interp(streak.column, np.arange(len(grid.x_m)), grid.x_m)),
            "streak_y_m": float(np.interp(streak.row, np.arange(len(y)), y)),
        }
        for streak in found.streaks
    ]
    Products(products_path).write(
        STAGE,
        {"power": found.power.astype(np.float32), "x_m": grid.x_m, "y_m": y},
        settings={
            "targets": [{**target, **streak} for target, streak in zip(result.targets(), streaks, strict=True)],
            "rejected": [item.reason for item in found.rejected],
            "tiles": found.tiles,
        },
        inputs=[source],
        units={"x_m": "m", "y_m": "m"},
    )


def moving_targets(
    path: Path | str,
    *,
    x_m: tuple[float, float] | None = None,
    y_m: tuple[float, float] | None = None,
    false_alarm: float = 1e-3,
    max_azimuth_m_s: float = 20.0,
) -> HistoryResult:
    """Find moving targets in a phase history.

    Args:
        path: .npz file with :data:`NEEDED`, or products file with the stage "history" of a simulation, of which the
            stronger co-polarized channel is taken.
        x_m, y_m: first and last place of the picture along and across the track, in the file's coordinates; where left
            out, the middle 60 % of the track and what of the swath is seen from all of it.
        false_alarm: probability that a tile of speckle shows a streak.
        max_azimuth_m_s: fastest speed along the track.

    Raises:
        PolfuseError: a file that cannot be used, or a picture without end.
        DataError: data that cannot be used.
    """
    held = _simulated(Products(path)) if is_products(path) else _read(Path(path))
    time = held["time_s"]
    count = len(time)
    # Motion is told from the track.
    _, track_y, track_z = held["antenna_m"].mean(axis=0)
    antenna = held["antenna_m"] - np.array([0.0, track_y, track_z])
    history = PhaseHistory(
        held["echoes"][None], float(held["first_hz"]), float(held["step_hz"]), antenna,
        np.broadcast_to(held["reference_m"], (count,)).astype(np.float64), ("HH",),
    )  # fmt: skip
    profiles = history_profiles(history, oversampling=2)
    z, beam = float(held["z_m"] - track_z), float(held["beamwidth_rad"])
    height = abs(z)
    slant = float(np.mean(history.reference_m))
    x_first, x_last = x_m or _inner(antenna[:, 0])
    near, far, walk = _swath(antenna[:, 0], height, history, (x_first, x_last))
    if far <= near:
        raise PolfuseError(
            f"has a swath of {history.unambiguous_m:.0f} m in which echoes walk by {walk:.0f} m",
            where=str(path),
            advice="take fewer pulses at a time, or say a smaller --x",
        )
    y_first, y_last = (near, far) if y_m is None else (y_m[0] - track_y, y_m[1] - track_y)
    middle = (y_first + y_last) / 2
    along = profiles.wavelength_m / (4 * math.tan(beam / 2)) * 1.2
    down = profiles.resolution_m * math.hypot(middle, height) / middle * 0.75
    grid = ImageGrid(np.arange(x_first, x_last, along), np.arange(y_first, y_last, down), z)
    if not 0 < grid.shape[0] * grid.shape[1] <= _LARGEST_PIXELS:
        raise PolfuseError(
            f"asks for a picture of {grid.shape[1]} x {grid.shape[0]} pixels",
            where=str(path),
            advice=f"say --x and --y, up to {_LARGEST_PIXELS / 1e6:g} million pixels",
        )
    found = find_moving(
        profiles, time, grid, beamwidth_rad=beam,
        radon=RadonSettings(tile_px=min(64, min(grid.shape)), false_alarm=false_alarm),
        estimate=EstimateSettings(max_azimuth_m_s=max_azimuth_m_s),
    )  # fmt: skip
    speed = float(np.linalg.norm(antenna[-1] - antenna[0]) / np.ptp(time))
    passage = Passage(
        speed, slant, profiles.wavelength_m, 2 * slant * math.tan(beam / 2) / speed, (count - 1) / float(np.ptp(time))
    )
    return HistoryResult(found, grid, ambiguities(passage), float(track_y))


def _swath(
    antenna_x_m: Floats, height_m: float, history: PhaseHistory, x_m: tuple[float, float]
) -> tuple[float, float, float]:
    """Ground ranges from and to which all of a strip is in every pulse's profile, and how far its echoes walk, m."""
    reference, half = history.reference_m, _SWATH * history.unambiguous_m
    least = np.maximum(np.maximum(x_m[0] - antenna_x_m, antenna_x_m - x_m[1]), 0.0)
    most = np.maximum(np.abs(x_m[0] - antenna_x_m), np.abs(x_m[1] - antenna_x_m))
    near = np.maximum(reference - half, 0.0) ** 2 - height_m**2 - least**2
    far = (reference + half) ** 2 - height_m**2 - most**2
    slant = float(reference.min())
    walk = math.hypot(slant, float(most.max())) - slant
    return math.sqrt(max(float(near.max()), 0.0)), math.sqrt(max(float(far.min()), 0.0)), walk


def _inner(x_m: Floats) -> tuple[float, float]:
    """The middle part of a track, over which targets are seen for long."""
    first, last = float(x_m.min()), float(x_m.max())
    return first + 0.2 * (last - first), last - 0.2 * (last - first)


def write_example(path: Path | str, *, seed: int = 0) -> Path:
    """Simulate a collect with the geometry of thesis Table 8.1 (a quarter of its band) over three vehicles, and write
    it."""
    from processing.motion.simulation import MovingPoint, ground_clutter, moving_history, receiver_noise, strip_collect

    random = np.random.default_rng(seed)
    collect = strip_collect(bandwidth_hz=20e6)
    vehicles = [
        MovingPoint((-200.0, 14_950.0, -15_000.0), (8.0, 3.0, 0.0)),
        MovingPoint((50.0, 15_080.0, -15_000.0), (-6.0, -4.0, 0.0)),
        MovingPoint((300.0, 15_020.0, -15_000.0), (-10.0, 6.0, 0.0)),
    ]
    echoes = moving_history(vehicles, collect).echoes[0]
    echoes = echoes + ground_clutter(collect, 5.0, random) + receiver_noise(collect, 2.0, random)
    out = Path(path)
    with out.open("xb") as file:
        np.savez(
            file, echoes=echoes.astype(np.complex64), first_hz=collect.first_hz, step_hz=collect.step_hz,
            antenna_m=collect.antenna_m, reference_m=collect.reference_m, time_s=collect.time_s,
            beamwidth_rad=float(collect.beamwidth_rad or 0.0), z_m=-15_000.0,
        )  # fmt: skip
    return out


def _simulated(products: Products) -> dict[str, NDArray[Any]]:
    """:data:`NEEDED` of a simulated scene."""
    held, settings = products.read("history"), products.settings("history")
    if settings["beamwidth_rad"] is None:
        raise PolfuseError(
            "was lit evenly from all of the track, so that nothing tells when a target was abeam",
            where=str(products.path),
            advice='simulate it with radar.beamwidth_deg in the scene file, as table = "8.1" has',
        )
    channels = [held["echoes"][settings["channels"].index(name)] for name in ("HH", "VV")]
    strongest = max(channels, key=lambda echoes: float(np.linalg.norm(echoes)))
    numbers = {name: np.asarray(settings[name]) for name in ("first_hz", "step_hz", "beamwidth_rad", "z_m")}
    return {**{name: held[name] for name in ("antenna_m", "reference_m", "time_s")}, **numbers, "echoes": strongest}


def _read(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            held = {name: np.asarray(file[name]) for name in NEEDED if name in file.files}
    except Exception as error:
        # Damaged archives raise nearly every kind of exception.
        raise PolfuseError("is no NumPy file of arrays", where=str(path), advice="write it by numpy.savez") from error
    missing = [name for name in NEEDED if name not in held]
    if missing:
        raise PolfuseError(f"lacks {', '.join(missing)}", where=str(path), advice=f"give {', '.join(NEEDED)}")
    pulses = len(held["time_s"]) if held["time_s"].ndim == 1 else -1
    fits = held["echoes"].ndim == 2 and len(held["echoes"]) == pulses and held["antenna_m"].shape == (pulses, 3)
    scalars = all(held[name].ndim == 0 for name in ("first_hz", "step_hz", "beamwidth_rad", "z_m"))
    if not (fits and scalars and held["reference_m"].shape in ((), (pulses,))):
        raise PolfuseError(
            "has arrays that do not fit each other",
            where=str(path),
            advice="give echoes (pulses, frequencies), antenna_m (pulses, 3), time_s (pulses,) and single numbers",
        )
    if not all(np.issubdtype(a.dtype, np.number) and np.isfinite(a).all() for a in held.values()):
        raise PolfuseError("holds undefined values", where=str(path), advice="leave such pulses out")
    return held
