"""Autofocus against errors that are known, and on data that need none: ``accuracy.autofocus``."""

from __future__ import annotations

import numpy as np

from benchmarks.autofocus_scenes import ERRORS, random_scene, without_points
from benchmarks.rows import Row
from processing.sar.autofocus import LARGEST_MOVE_CELLS, autofocus
from processing.sar.backprojection import backproject
from processing.sar.sharpness import image_entropy

SCENES, QUICK = 12, 2
LEFT_RAD = {"slow phase": 0.3, "random phase": 0.3, "trolley": 0.3}
"""Largest median of what is left, rad rms; 0.3 costs a peak 0.4 dB."""


def run(quick: bool) -> list[Row]:
    """Rows: residual phase before and after for each error, and harm done where there is none."""
    seeds = range(QUICK if quick else SCENES)
    rows = []
    for error in ERRORS[1:]:
        before, after, taken = [], [], 0
        for seed in seeds:
            scene = random_scene(seed, error)
            found = autofocus(scene.profiles, scene.grid)
            before.append(scene.residual_rad())
            after.append(scene.residual_rad(found))
            taken += found.applied
        left = float(np.median(after))
        ratios = np.array(after) / np.array(before)
        rows.append(
            Row(
                f"accuracy.autofocus.{error.replace(' ', '_')}",
                "no autofocus",
                float(np.median(ratios)),
                bool(left <= LEFT_RAD[error]),
                f"phase left at the points, median at most {LEFT_RAD[error]:g} rad rms",
                float(ratios.min()),
                float(ratios.max()),
                f"{left:.3f} rad of {float(np.median(before)):.3f}, applied {taken} of {len(before)}",
            )
        )
    harm, worst = 0, 0.0
    for seed in seeds:
        scene = random_scene(seed, "none")
        for focused in (scene, without_points(scene, seed)):
            found = autofocus(focused.profiles, focused.grid)
            images = [backproject(p, focused.grid) for p in (focused.profiles, found.corrected(focused.profiles))]
            rise = image_entropy(images[1]) - image_entropy(images[0])
            move = found.largest_move_cells if found.applied else 0.0
            worst = max(worst, rise)
            harm += rise > 0 or move >= LARGEST_MOVE_CELLS
    rows.append(
        Row(
            "accuracy.autofocus.focused",
            "no autofocus",
            None,
            harm == 0,
            f"entropy never rises, peaks move less than {LARGEST_MOVE_CELLS:g} cell",
            error=f"harm in {harm} of {2 * len(seeds)}, entropy rises by {worst:.4f} at most",
        )
    )
    return rows
