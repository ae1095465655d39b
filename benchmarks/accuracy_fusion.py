"""Table 7.3, 6.3 and 9.1 of the thesis on a warehouse of our own: what DOLP adds to the radar's Pauli components.

Nothing here is fitted to the thesis's numbers, which are stated beside ours. Its scene (DIRSIG's), its materials and
the portions that its author cut out are not known; ours are in :mod:`processing.scene.warehouse`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from benchmarks.rows import Row
from benchmarks.warehouse_fusion import (
    CLASSES,
    FUSED,
    PAULI,
    RED_BLUE,
    SUN_RAD,
    Fused,
    Pair,
    fuse,
    grid_320x150,
    pair,
)
from processing.fusion.features import FEATURES
from processing.sar.grid import ImageGrid
from processing.scene.both_eyes import bodies_from_above, radar_picture
from processing.scene.warehouse import Finish, warehouse

Floats = np.ndarray

FINISHES: tuple[Finish, ...] = ("ordinary", "dark gloss")
COLUMNS = (PAULI, FUSED, RED_BLUE)
FLAT = ("ground", "asphalt", "concrete")
ALL = "all land cover"
FIRST_SET = "clear ground against the building"
SECOND_SET = "clear ground against containers"
"""As the thesis describes the portions of Figs. 7.20 and 7.23."""
CLEAR_M = 2.5
"""Ground this far from all bodies is a portion of grass or asphalt alone."""


def run(quick: bool) -> list[Row]:
    """All rows."""
    sets = {(finish, turn): _look(finish, turn, quick) for finish in FINISHES for turn in (0, 45)}
    told = {which: _pairs(fused) for which, fused in sets.items()}
    rows = []
    for (finish, turn), pairs in told.items():
        rows += _set(finish, turn, pairs)
    rows += _table(told)
    rows.append(_needed(sets["ordinary", 0], told["ordinary", 0]))
    rows += _mechanisms(sets["ordinary", 0])
    return rows


def _look(finish: Finish, turn_deg: int, quick: bool) -> Fused:
    scene, grid = warehouse(container_turn_rad=math.radians(turn_deg), finish=finish), _grid(quick)
    return fuse(scene, grid, radar_picture(scene, grid), next(iter(SUN_RAD)))


def _grid(quick: bool) -> ImageGrid:
    grid = grid_320x150()
    return ImageGrid(grid.x_m[::2], grid.y_m[::2], 0.0) if quick else grid


def portions(fused: Fused, ground: tuple[str, ...], bodies: tuple[str, ...]) -> Floats:
    """Truth (ny, nx) of portions as the thesis cuts them: clear ground (0), all of the bodies named (1), trees (2)."""
    grid = fused.grid
    above = bodies_from_above(fused.scene, grid)
    kinds = np.array([solid.kind for solid in fused.scene.solids])[above]
    step = float(np.diff(grid.y_m[:2])[0]), float(np.diff(grid.x_m[:2])[0])
    clear = distance_transform_edt(np.isin(kinds, FLAT), sampling=step) > CLEAR_M
    truth = np.full(kinds.shape, -1)
    truth[np.isin(kinds, ground) & clear] = 0
    truth[np.isin(kinds, bodies)] = 1
    truth[kinds == "tree"] = 2
    return truth


@dataclass(frozen=True)
class Three:
    """Two classes by the three sets of features of Table 7.3."""

    alone: Pair
    added: Pair
    replaced: Pair


def _pairs(fused: Fused) -> dict[str, Three]:
    """Single against double bounce, by everything that the yard has and by portions of it."""
    truths = {
        ALL: fused.bodies,
        FIRST_SET: portions(fused, FLAT, ("building",)),
        SECOND_SET: portions(fused, FLAT, ("container",)),
        "clear grass against containers": portions(fused, ("ground",), ("container",)),
    }
    return {name: Three(*(pair(fused, truth, which) for which in COLUMNS)) for name, truth in truths.items()}


def _set(finish: Finish, turn: int, pairs: dict[str, Three]) -> list[Row]:
    rows = []
    for name, three in pairs.items():
        told = f"{finish}, containers at {turn} degrees, {name}"
        ours = [f"{each.distance:.2f}" for each in (three.alone, three.added, three.replaced)]
        rows.append(
            Row(
                f"{told}: B(single, double) by Pauli / with DOLP / red, blue and DOLP", "as normal classes", None,
                three.added.distance > three.alone.distance, "DOLP adds", error=" / ".join(ours),
            )
        )  # fmt: skip
        rows.append(
            Row(
                f"{told}: error of a normal likelihood classifier by Pauli / with DOLP", "the scene's truth, and the "
                "bounds of 7.26", None, three.added.error < three.alone.error, "DOLP lowers the error",
                error=f"{_by_normal(three.alone)} / {_by_normal(three.added)}",
            )
        )  # fmt: skip
        inside = [_inside(each) for each in (three.alone, three.added)]
        chance = 3 * math.hypot(three.added.spread_by_shape, three.alone.spread_by_shape)
        lowers = three.added.error_by_shape < three.alone.error_by_shape + chance
        rows.append(
            Row(
                f"{told}: error by classes of the shape that they have, by Pauli / with DOLP", "the scene's truth, and "
                "the bounds by that shape", None, all(inside) and lowers,
                "within the bounds, not higher with DOLP (3 sd)",
                error=f"{_by_shape(three.alone)} / {_by_shape(three.added)}",
            )
        )  # fmt: skip
    return rows


def _by_normal(each: Pair) -> str:
    inside = "within" if each.lower <= each.error <= each.upper else "outside"
    return f"{each.error:.3f} ({inside} {each.lower:.3g} to {each.upper:.3g})"


def _by_shape(each: Pair) -> str:
    lower, upper = each.by_shape.bounds
    error = f"{each.error_by_shape:.3f} +- {each.spread_by_shape:.3f}"
    return f"{error} ({lower:.3g} to {upper:.3g}, B {each.by_shape.distance:.2f})"


def _inside(each: Pair) -> bool:
    """Within the bounds but for chance."""
    spread = 3 * each.spread_by_shape
    return each.by_shape.bounds.lower - spread <= each.error_by_shape <= each.by_shape.bounds.upper + spread


def _table(told: dict[tuple[Finish, int], dict[str, Three]]) -> list[Row]:
    """What Table 7.3 says of its two sets, in both finishes."""
    rows = []
    for finish in FINISHES:
        first, second = told[finish, 0][FIRST_SET], told[finish, 45][SECOND_SET]
        rises = first.alone.distance < 3 and first.added.distance > 5
        everything = told[finish, 0][ALL]
        rows.append(
            Row(
                f"{finish}: {ALL}, B from below 3 by Pauli to above 5 with DOLP", "thesis 1.72 to 9.93, of portions",
                None, everything.alone.distance < 3 and everything.added.distance > 5, "below 3, then above 5",
                error=f"{everything.alone.distance:.2f} to {everything.added.distance:.2f}",
            )
        )  # fmt: skip
        rows.append(
            Row(
                f"{finish}: set 1 ({FIRST_SET}), B from below 3 by Pauli to above 5 with DOLP", "thesis 1.72 to 9.93",
                None, rises, "below 3, then above 5",
                error=f"{first.alone.distance:.2f} to {first.added.distance:.2f}",
            )
        )  # fmt: skip
        ours = [
            f"{of.distance:.2f} to {at.distance:.2f}"
            for of, at in ((first.alone, second.alone), (first.added, second.added))
        ]
        lower = second.alone.distance < first.alone.distance and second.added.distance < first.added.distance
        rows.append(
            Row(
                f"{finish}: set 2 ({SECOND_SET} at 45 degrees) is told apart less than set 1, by Pauli, with DOLP",
                "thesis 1.72 to 0.63, 9.93 to 8.22", None, lower, "lower at 45 degrees", error=", ".join(ours),
            )
        )  # fmt: skip
        straight, turned = (told[finish, turn][SECOND_SET].alone.distance for turn in (0, 45))
        rows.append(
            Row(
                f"{finish}: B(ground, containers) by Pauli when the containers are turned to 45 degrees", "lower", None,
                turned < straight, "lower at 45 degrees", error=f"{straight:.2f} to {turned:.2f}",
            )
        )  # fmt: skip
    return rows


def _needed(fused: Fused, pairs: dict[str, Three]) -> Row:
    """From ``B = d^2 / (8 s^2)`` of DOLP alone, added to what Pauli gives."""
    dolp = [fused.features[3][(fused.bodies == k) & np.isfinite(fused.features[3])] for k in (0, 1)]
    variance = (dolp[0].var() + dolp[1].var()) / 2
    least = math.sqrt(8 * (5 - pairs[ALL].alone.distance) * variance)
    return Row(
        "ordinary, all land cover: difference of DOLP's class means that B above 5 would need, with our spreads",
        "thesis 0.36", None, True, "reported, no target",
        error=f"{least:.2f}; ours {dolp[1].mean() - dolp[0].mean():.3f}",
    )  # fmt: skip


def _mechanisms(fused: Fused) -> list[Row]:
    """Tables 6.3 and 9.1: what each mechanism shows in both eyes, where it outdoes the others tenfold."""
    means = []
    for number in range(len(CLASSES)):
        chosen = (fused.mechanisms == number) & np.isfinite(fused.features).all(axis=0)
        means.append(fused.features[:, chosen].mean(axis=1))
    rows = []
    dominant = {0: 2, 1: 0}
    for number, name in enumerate(CLASSES):
        values = ", ".join(f"{feature} {value:.3f}" for feature, value in zip(FEATURES, means[number], strict=True))
        ok = number not in dominant or int(np.argmax(means[number][:3])) == dominant[number]
        # Random dipoles return 8 : 4 : 1 in |HH+VV|^2, |HH-VV|^2, |HV|^2: their HV is most in comparison only.
        ok &= number != 2 or means[2][1] == max(mean[1] for mean in means)
        told = f"{name} bounce: components and DOLP"
        rows.append(Row(told, "Table 6.3", None, bool(ok), _TARGETS[number], error=values))
    single, double, multiple = (float(mean[3]) for mean in means)
    rows.append(
        Row(
            "DOLP is highest for double bounce", "Table 6.3: low, high, low", None, double > max(single, multiple),
            "double above single and multiple", error=f"{single:.3f}, {double:.3f}, {multiple:.3f}",
        )
    )  # fmt: skip
    return rows


_TARGETS = ("|HH+VV| is most", "|HH-VV| is most", "|HV| is more than in the others")
