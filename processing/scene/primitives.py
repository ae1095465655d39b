"""Bodies as triangles: ground, box, building, container, car, tree, person. Each stands on z = 0 around the origin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.raytrace.shapes import patch, sphere
from processing.raytrace.triangles import Triangles, joined
from processing.scene.model import Bush
from processing.scene.solids import Part, Solid

Floats = NDArray[np.float64]

CONTAINER_M = (6.058, 2.438, 2.591)
"""Length, width and height of a 20-foot container (ISO 668, 1CC)."""
CAR_M = (4.4, 1.8, 1.45)
"""Length, width and height."""
PERSON_M = (0.45, 0.30, 1.75)
"""Width, depth and height of the ellipsoid."""


def ground(
    width_m: float, depth_m: float, substance: str, *, hole_m: tuple[float, float, float, float] | None = None
) -> Solid:
    """A rectangle of ground, ``width_m`` along x.

    Args:
        width_m, depth_m: m.
        substance: of the ground.
        hole_m: x from, x to, y from, y to of a rectangle inside that is left out, for another ground.

    Raises:
        DataError: a hole that does not lie inside.
    """
    x0, x1, y0, y1 = -width_m / 2, width_m / 2, -depth_m / 2, depth_m / 2
    if hole_m is None:
        return Solid("ground", "ground", (Part(_flat(x0, x1, y0, y1, 0.0), substance),))
    a, b, c, d = hole_m
    if not (x0 < a < b < x1 and y0 < c < d < y1):
        raise DataError(f"a hole {hole_m} does not lie in a ground of {width_m} x {depth_m} m", "make it smaller")
    around = [_flat(x0, x1, y0, c, 0.0), _flat(x0, x1, d, y1, 0.0), _flat(x0, a, c, d, 0.0), _flat(b, x1, c, d, 0.0)]
    return Solid("ground", "ground", (Part(joined(around), substance),))


def building(
    width_m: float, depth_m: float, height_m: float, *, wall: str, roof: str, door: str | None = None
) -> Solid:
    """A flat-roofed building; with ``door`` each long wall has a strip of that substance, 60 % wide and high."""
    parts = [Part(_flat(-width_m / 2, width_m / 2, -depth_m / 2, depth_m / 2, height_m), roof)]
    walls = [_wall(depth_m, height_m, (x, 0.0), turned=True) for x in (-width_m / 2, width_m / 2)]
    for y in (-depth_m / 2, depth_m / 2):
        if door is None:
            walls.append(_wall(width_m, height_m, (0.0, y)))
            continue
        side, over = 0.2 * width_m, 0.6 * height_m
        walls += [_wall(side, height_m, (x, y)) for x in (-0.4 * width_m, 0.4 * width_m)]
        walls.append(patch((-0.3 * width_m, y, over), (0.6 * width_m, 0.0, 0.0), (0.0, 0.0, height_m - over)))
        parts.append(Part(_wall(0.6 * width_m, over, (0.0, y)), door))
    return Solid("building", "building", (*parts, Part(joined(walls), wall)))


def container(substance: str, *, size_m: tuple[float, float, float] = CONTAINER_M) -> Solid:
    """A shipping container, its length along x."""
    return Solid("container", "container", (Part(_box(*size_m), substance),))


def car(body: str, glass: str) -> Solid:
    """A car, its length along x and its nose at +x: a body of two heights with sloping windows."""
    length, width, height = CAR_M
    clear, belt = 0.2, 0.9
    # The profile of the cabin: bottom of the rear window, roof, bottom of the windscreen.
    rear, roof_rear, roof_front, front = -0.48 * length, -0.30 * length, 0.05 * length, 0.27 * length
    half = width / 2
    lower = _box(length, width, belt - clear, at_m=(0.0, 0.0, clear), bottom=True)
    roof = _flat(roof_rear, roof_front, -half, half, height)
    panes = [
        patch((roof_front, -half, height), (front - roof_front, 0.0, belt - height), (0.0, width, 0.0)),
        patch((rear, -half, belt), (roof_rear - rear, 0.0, height - belt), (0.0, width, 0.0)),
    ]
    for y in (-half, half):
        corners = np.array([[rear, y, belt], [front, y, belt], [roof_front, y, height], [roof_rear, y, height]])
        panes.append(Triangles(corners, np.array([[0, 1, 2], [0, 2, 3]])))
    return Solid("car", "car", (Part(joined([lower, roof]), body), Part(joined(panes), glass)))


def tree(
    crown_m: float,
    trunk_m: float,
    *,
    leaf: str,
    bark: str,
    backscatter: float = 0.1,
    dipoles: int = 1500,
    leaves: int = 500,
    leaf_m: float = 0.35,
    seed: int = 0,
) -> Solid:
    """A tree: a trunk, a ball of leaves for optics and of thin dipoles for radar.

    Args:
        crown_m: radius of the crown, m.
        trunk_m: height of the trunk up to the crown's lower end, m.
        leaf, bark: substances; ``leaf`` is passed by radar waves.
        backscatter: RCS of the crown over its cross-section, co-polarized; -10 dB is what trees show on average from
            1 to 18 GHz (Ulaby and Dobson 1989, Handbook of radar scattering statistics for terrain).
        dipoles: of the cloud.
        leaves: triangles, each standing for a tuft.
        leaf_m: their edge, m.
        seed: of both.

    Raises:
        DataError: sizes that are not positive.
    """
    if not (crown_m > 0 and trunk_m > 0 and leaf_m > 0 and leaves > 0 and dipoles > 0):
        raise DataError(f"a tree of crown {crown_m} m and trunk {trunk_m} m", "give positive sizes and numbers")
    centre = (0.0, 0.0, trunk_m + crown_m)
    cloud = Bush("crown", centre, crown_m, dipoles, backscatter * float(np.pi) * crown_m**2, seed)
    random = np.random.default_rng(seed + 1)
    offsets = random.standard_normal((leaves, 3))
    offsets *= (crown_m * np.cbrt(random.random(leaves)) / np.linalg.norm(offsets, axis=1))[:, None]
    axes = random.standard_normal((leaves, 2, 3))
    first = axes[:, 0] / np.linalg.norm(axes[:, 0], axis=1, keepdims=True)
    second = axes[:, 1] - np.sum(axes[:, 1] * first, axis=1, keepdims=True) * first
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    angles = 2 * np.pi / 3 * np.arange(3)
    reach = leaf_m / np.sqrt(3)
    corners = (offsets + centre)[:, None] + reach * (
        np.cos(angles)[None, :, None] * first[:, None] + np.sin(angles)[None, :, None] * second[:, None]
    )
    tufts = Triangles(corners.reshape(-1, 3), np.arange(3 * leaves).reshape(-1, 3))
    return Solid("tree", "tree", (Part(_column(0.15, trunk_m + crown_m / 2), bark), Part(tufts, leaf)), (cloud,))


def person(substance: str) -> Solid:
    """A person: an upright ellipsoid."""
    shape = sphere(0.5, divisions=2).turned(np.diag(PERSON_M)).moved((0.0, 0.0, PERSON_M[2] / 2))
    return Solid("person", "person", (Part(shape, substance),))


def box(width_m: float, depth_m: float, height_m: float, substance: str) -> Solid:
    """A box without a bottom."""
    return Solid("box", "box", (Part(_box(width_m, depth_m, height_m), substance),))


def _flat(x0: float, x1: float, y0: float, y1: float, z: float) -> Triangles:
    return patch((x0, y0, z), (x1 - x0, 0.0, 0.0), (0.0, y1 - y0, 0.0))


def _wall(width_m: float, height_m: float, at: tuple[float, float], *, turned: bool = False) -> Triangles:
    """An upright wall centred at (x, y), along x (or along y when turned)."""
    along = (0.0, width_m, 0.0) if turned else (width_m, 0.0, 0.0)
    return patch((at[0] - along[0] / 2, at[1] - along[1] / 2, 0.0), along, (0.0, 0.0, height_m))


def _box(
    width_m: float,
    depth_m: float,
    height_m: float,
    *,
    at_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    bottom: bool = False,
) -> Triangles:
    x, y = width_m / 2, depth_m / 2
    faces = [_flat(-x, x, -y, y, height_m)]
    faces += [_wall(width_m, height_m, (0.0, side)) for side in (-y, y)]
    faces += [_wall(depth_m, height_m, (side, 0.0), turned=True) for side in (-x, x)]
    if bottom:
        faces.append(_flat(-x, x, -y, y, 0.0))
    return joined(faces).moved(at_m)


def _column(radius_m: float, height_m: float, sides: int = 12) -> Triangles:
    """An upright prism without ends."""
    angle = 2 * np.pi / sides * np.arange(sides + 1)
    low = np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle), np.zeros(sides + 1)], axis=1)
    return joined([patch(low[k], low[k + 1] - low[k], (0.0, 0.0, height_m)) for k in range(sides)])
