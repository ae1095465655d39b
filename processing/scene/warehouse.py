"""A yard with a warehouse, containers, cars, trees, asphalt and grass, in the spirit of the thesis's 7.2.

Sizes are those of the real things. Permittivities are ITU-R P.2040's (:mod:`processing.scattering.permittivity`) but
for asphalt (dry asphalt concrete, e' 4 to 8) and skin (Gabriel 1996, at 10 GHz). Roughness: 1 mm of worn asphalt, 10 mm
of grown ground, 5 mm of bark. Optical indices: 1.5 of paint, glass and mineral, 1.45 of leaves' wax (Vanderbilt and
Grant 1985, IEEE TGRS 23), the thesis's 1.02 + 6.84i of aluminium (4.6).

Two finishes of the same yard: ordinary light cladding, dark containers and asphalt; and dark gloss on walls, roof and
containers with a yard of concrete. In light that comes from behind the camera only what is mirrored is polarized, so
DOLP needs a mirror (gloss) that returns little else (dark), and something bright to be mirrored (concrete, the sky).
"""

from __future__ import annotations

import math
from typing import Literal

from processing.errors import DataError
from processing.raytrace.materials import Fresnel, Lambert
from processing.scattering.permittivity import permittivity
from processing.scattering.surfaces import CONDUCTOR, RadarSurface
from processing.scene import primitives
from processing.scene.solids import Solid, SolidScene, Substance

YARD_M = (64.0, 44.0)
"""Width along the track and depth of the whole ground."""
ASPHALT_M = (-27.0, 15.0, -17.0, 9.0)
"""x from, x to, y from, y to of the asphalt."""
BUILDING_M = (24.0, 10.0, 6.0)
Finish = Literal["ordinary", "dark gloss"]
BLACK_GLOSS = Fresnel(1.5, 0.02, 0.95, 0.03)
"""A clear coat over black: 3 % of the light comes back from below it."""
CONCRETE = Fresnel(1.5, 0.35, 0.6, 0.35)
"""Worn concrete's albedo is 0.2 to 0.4."""


def substances(frequency_hz: float, finish: Finish = "ordinary") -> tuple[Substance, ...]:
    """What the yard is made of, at a radar's frequency. Raises :class:`DataError` outside 0.1 to 100 GHz."""
    soil = permittivity("medium dry ground", frequency_hz)
    if finish == "ordinary":
        yard = Substance("asphalt", RadarSurface(5 - 0.2j, 0.001), Fresnel(1.5, 0.35, 0.85, 0.10))
        cladding, roofing, steel = _paint(0.30), Fresnel(1.02 + 6.84j, 0.15, 0.5, 0.2), _paint(0.06)
    elif finish == "dark gloss":
        yard = Substance("concrete", RadarSurface(permittivity("concrete", frequency_hz), 0.001), CONCRETE)
        cladding = roofing = steel = BLACK_GLOSS
    else:
        raise DataError(f"there is no finish {finish!r}", "use 'ordinary' or 'dark gloss'")
    return (
        yard,
        Substance("grass", RadarSurface(soil, 0.010), Fresnel(1.45, 0.6, 0.5, 0.10)),
        Substance("cladding", CONDUCTOR, cladding),
        Substance("roofing", CONDUCTOR, roofing),
        Substance("steel", CONDUCTOR, steel),
        Substance("car paint", CONDUCTOR, Fresnel(1.5, 0.01, 0.9, 0.05)),
        Substance("glass", RadarSurface(permittivity("glass", frequency_hz)), Fresnel(1.5, 0.0, 0.99, 0.005)),
        Substance("leaves", None, Fresnel(1.45, 0.3, 0.6, 0.12)),
        Substance("bark", RadarSurface(permittivity("wood", frequency_hz), 0.005), Lambert(0.15)),
        Substance("clothing", RadarSurface(31 - 14j, 0.002), Lambert(0.3)),
    )


def warehouse(
    frequency_hz: float = 15e9, *, container_turn_rad: float = 0.0, finish: Finish = "ordinary", seed: int = 1
) -> SolidScene:
    """The yard, its middle at the origin on z = 0.

    Args:
        frequency_hz: of the radar, for the permittivities.
        container_turn_rad: angle of the containers' long sides from the track; the thesis has 0 and 45 degrees.
        finish: ``"ordinary"`` (asphalt, light walls) or ``"dark gloss"`` (concrete; walls, roof, containers black).
        seed: of the trees.

    Raises:
        DataError: a frequency outside 0.1 to 100 GHz, or an unknown finish.
    """
    x0, x1, y0, y1 = ASPHALT_M
    known = substances(frequency_hz, finish)
    surface = known[0].name
    yard = primitives.ground(x1 - x0, y1 - y0, surface).placed(((x0 + x1) / 2, (y0 + y1) / 2, 0.0))
    solids: list[Solid] = [
        primitives.ground(*YARD_M, "grass", hole_m=ASPHALT_M),
        Solid(surface, surface, yard.parts),
        primitives.building(*BUILDING_M, wall="cladding", roof="roofing").placed((-8.0, 15.0, 0.0)),
    ]
    for number, x in enumerate((-20.0, -10.0, 0.0)):
        for row, y in enumerate((-3.0, -11.5)):
            box = primitives.container("steel").placed((x + 1.5 * row, y, 0.0), container_turn_rad)
            solids.append(Solid(f"container {2 * number + row + 1}", box.kind, box.parts))
    for number, (x, y, turn) in enumerate(
        ((9.0, -13.0, 90.0), (12.0, -13.0, 90.0), (9.0, -5.0, 0.0), (-15.0, 4.5, 5.0))
    ):
        made = primitives.car("car paint", "glass").placed((x, y, 0.0), math.radians(turn))
        solids.append(Solid(f"car {number + 1}", made.kind, made.parts))
    places = ((20.0, -14.0), (24.5, -8.0), (20.5, -2.0), (26.0, 3.5), (21.0, 9.0), (25.0, 15.5))
    for number, (x, y) in enumerate(places):
        grown = primitives.tree(2.0 + 0.15 * (number % 3), 1.6, leaf="leaves", bark="bark", seed=seed + 10 * number)
        grown = grown.placed((x, y, 0.0))
        solids.append(Solid(f"tree {number + 1}", grown.kind, grown.parts, grown.clouds))
    walker = primitives.person("clothing").placed((5.0, 2.0, 0.0))
    return SolidScene("warehouse", known, (*solids, walker))


def _paint(diffuse: float) -> Fresnel:
    """Glossy paint on sheet metal."""
    return Fresnel(1.5, 0.05, 0.5, diffuse)
