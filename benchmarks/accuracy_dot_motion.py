"""What motion between the exposures of a turning polarizer does to DOLP, and how much of it is taken away: by the
velocity that the radar measured, by the pictures alone, and by a peer's dense optical flow (TV-L1, scikit-image).

The radar's velocity is that of a simulated collect over the same object (:mod:`benchmarks.accuracy_motion`), not the
true one; it is projected into the camera by the common geometry. Errors are root mean squares of DOLP against the truth
over the pixels that motion spoils; pixels that come out undefined (ground that the object hid in two exposures or more)
are told beside them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy_motion import collected, seen_at
from benchmarks.motion_scene import MATRIX, RoadScene, dolp_of
from benchmarks.rows import Row
from processing.motion.division_of_time import camera_displacement, compensate, error_image
from processing.motion.estimate import estimate_motion
from processing.motion.flow import displacement_by_pictures
from processing.motion.simulation import MovingPoint, strip_collect

LEAST_DB = 10.0
Values = NDArray[Any]


def run(quick: bool) -> list[Row]:
    """The worst of several objects and velocities; ``quick`` takes two instead of eight."""
    ways: dict[str, list[tuple[float, float, float]]] = {"radar": [], "pictures": [], "tv_l1": []}
    for seed in range(2 if quick else 8):
        for name, told in _scene(seed).items():
            ways[name].append(told)
    words = {
        "radar": "velocity from the radar", "pictures": "from the pictures alone", "tv_l1": "scikit-image's TV-L1 flow",
    }  # fmt: skip
    peer = float(np.median([gain for gain, _, _ in ways["tv_l1"]])) if ways["tv_l1"] else None
    rows = []
    for name in ("radar", "pictures"):
        gains, errors, undefined = (np.array(v) for v in zip(*ways[name], strict=True))
        rows.append(
            Row(f"dot_motion.{name}", "10 dB", float(gains.min()) / LEAST_DB, bool(gains.min() >= LEAST_DB),
                f"DOLP's error at least 10 dB down in each of {len(gains)} scenes, {words[name]}",
                ratio_min=float(gains.min()) / LEAST_DB, ratio_max=float(gains.max()) / LEAST_DB,
                error=f"DOLP {gains.min():.1f} to {gains.max():.1f} dB, error image {errors.min():.1f} to "
                      f"{errors.max():.1f} dB down; {100 * undefined.mean():.0f} % undefined",
                peer_error=None if peer is None else f"{words['tv_l1']}: {peer:.1f} dB in the middle")
        )  # fmt: skip
    rows.append(_beside_flow(ways, peer))
    return rows


def _beside_flow(ways: dict[str, list[tuple[float, float, float]]], peer: float | None) -> Row:
    """What the pictures alone give beside a dense optical flow, which leaves the scene to brightness that stays."""
    name = "scikit-image's TV-L1 flow"
    if peer is None:
        return Row("dot_motion.flow", name, None, True, "not compared: scikit-image is not installed")
    own = float(np.median([gain for gain, _, _ in ways["pictures"]]))
    return Row(
        "dot_motion.flow", name, None, own > peer, "DOLP's error falls by more than the peer's, in the middle scene",
        error=f"{own:.1f} dB down", peer_error=f"{peer:.1f} dB down",
    )  # fmt: skip


def _scene(seed: int) -> dict[str, tuple[float, float, float]]:
    random = np.random.default_rng(seed)
    heading, speed = random.uniform(0.25, 1.3) + np.pi / 2 * random.integers(0, 4), random.uniform(8, 14)
    velocity = (float(speed * np.cos(heading)), float(speed * np.sin(heading)), 0.0)
    scene = RoadScene(velocity, np.arange(4) * 0.25, seed)
    light = scene.exposures(random)
    told: dict[str, tuple[float, float, float]] = {}
    ways: dict[str, Callable[[], Values]] = {
        "radar": lambda: compensate(light, MATRIX, _by_radar(scene, random)).light,
        "pictures": lambda: compensate(light, MATRIX, displacement_by_pictures(light, MATRIX, scene.time_s)).light,
        "tv_l1": lambda: _by_dense_flow(light),
    }
    for name, work in ways.items():
        try:
            told[name] = _down(scene, light, work())
        except ImportError:
            continue
    return told


def _by_radar(scene: RoadScene, random: np.random.Generator) -> Values:
    collect = strip_collect()
    point = MovingPoint((0.0, 15_000.0, -15_000.0), scene.velocity_m_s)
    target = estimate_motion(
        collected(point, collect, random), collect.time_s, seen_at(point), beamwidth_rad=collect.beamwidth_rad
    )
    return camera_displacement(scene.camera, target.velocity_m_s, scene.time_s, -15_000.0)


def _by_dense_flow(light: Values) -> Values:
    """Each exposure warped onto the first along the flow of its brightness, scaled to the same mean and spread."""
    from skimage.registration import optical_flow_tvl1
    from skimage.transform import warp

    def even(image: Values) -> Values:
        return np.asarray((image - image.mean()) / image.std())

    row, column = np.mgrid[0 : light.shape[1], 0 : light.shape[2]].astype(float)
    out = [light[0]]
    for image in light[1:]:
        down, right = optical_flow_tvl1(even(light[0]), even(image), attachment=10)
        out.append(warp(image, np.array([row + down, column + right]), order=3, mode="edge", preserve_range=True))
    return np.stack(out)


def _down(scene: RoadScene, before: Values, after: Values) -> tuple[float, float, float]:
    """Decibels by which DOLP's error and the error image fall where motion spoils DOLP, and the part left undefined."""
    truth = dolp_of(np.tensordot(MATRIX, scene.stokes(0.0), 1))
    clean = np.stack([np.tensordot(m, scene.stokes(t), 1) for m, t in zip(MATRIX, scene.time_s, strict=True)])
    zone = np.abs(dolp_of(clean) - truth) > 0.01
    lost = np.isnan(after).any(axis=0)
    known = zone & ~lost
    pairs = [
        (dolp_of(before) - truth, dolp_of(after) - truth),
        (error_image(before, MATRIX), error_image(after, MATRIX)),
    ]
    # Both over the same pixels.
    gains = [10 * float(np.log10(np.mean(b[known] ** 2) / np.mean(a[known] ** 2))) for b, a in pairs]
    return gains[0], gains[1], float(lost[zone].mean())
