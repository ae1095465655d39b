"""Bodies for both eyes: their sizes, what each eye meets of them, and the warehouse in both."""

from __future__ import annotations

import math

import numpy as np
import pytest

from processing.errors import DataError
from processing.raytrace.materials import Lambert
from processing.raytrace.sources import Sun
from processing.sar.grid import ImageGrid
from processing.scattering.history import Sweep
from processing.scattering.shooting import Density
from processing.scattering.surfaces import CONDUCTOR, RadarSurface
from processing.scene import primitives
from processing.scene.both_eyes import Airborne, bodies_from_above, optical_picture, radar_picture, sunlight
from processing.scene.radar_simulation import MECHANISMS, RadarLook, simulate_radar, straight_track
from processing.scene.solids import Part, Solid, SolidScene, Substance
from processing.scene.warehouse import Finish, warehouse

METAL = Substance("metal", CONDUCTOR, Lambert(0.5))
SOIL = Substance("soil", RadarSurface(11 - 3j, 0.01), Lambert(0.1))
LEAF = Substance("leaf", None, Lambert(0.2))


def extent(solid: Solid) -> np.ndarray:
    points = np.concatenate([part.mesh.vertices_m for part in solid.parts])
    return np.asarray(np.ptp(points, axis=0))


def area(solid: Solid) -> float:
    corners = np.concatenate([part.mesh.corners_m for part in solid.parts])
    return float(
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    )


def test_bodies_have_their_sizes() -> None:
    np.testing.assert_allclose(extent(primitives.container("metal")), primitives.CONTAINER_M)
    # Of a car's height 0.2 m are free.
    np.testing.assert_allclose(extent(primitives.car("metal", "metal")), np.subtract(primitives.CAR_M, (0, 0, 0.2)))
    np.testing.assert_allclose(extent(primitives.person("metal")), primitives.PERSON_M, rtol=0.03)
    # ISO 668's container without its floor: two sides, two ends, a roof.
    length, width, height = primitives.CONTAINER_M
    assert area(primitives.container("metal")) == pytest.approx(2 * height * (length + width) + length * width)
    house = primitives.building(24, 10, 6, wall="metal", roof="metal", door="soil")
    # Doors are parts of the walls, not in front of them.
    assert area(house) == pytest.approx(2 * 6 * 34 + 240)
    ground = primitives.ground(20, 10, "soil", hole_m=(-2, 3, -1, 4))
    assert area(ground) == pytest.approx(200 - 25)


def test_a_body_is_turned_and_moved_with_its_cloud() -> None:
    tree = primitives.tree(2.0, 1.5, leaf="leaf", bark="soil", seed=3)
    moved = tree.placed((5.0, 7.0, 0.0), math.pi / 2)
    np.testing.assert_allclose(moved.clouds[0].position_m, (5.0, 7.0, 3.5), atol=1e-12)
    assert area(moved) == pytest.approx(area(tree))


def test_radar_passes_leaves_and_light_does_not() -> None:
    tree = primitives.tree(2.0, 1.5, leaf="leaf", bark="soil", leaves=50)
    scene = SolidScene("tree", (SOIL, LEAF), (tree,))
    assert len(scene.mesh()[0]) - len(scene.mesh(radar=True)[0]) == 50
    # A target of 1.26 m^2: -10 dB of the crown's cross-section, shared by dipoles behind no body.
    points = scene.volumes(scene.target(0.125), (0.0, -100.0, 50.0))
    power = np.sum(np.abs(points.amplitudes) ** 2, axis=0)
    # 1500 dipoles of fourth powers of cosines: 3 %.
    assert power[0, 0] == pytest.approx(0.1 * math.pi * 4, rel=0.12)
    assert power[0, 1] == pytest.approx(power[0, 0] / 3, rel=0.15)


def test_a_wall_hides_a_tree() -> None:
    wall = primitives.box(20, 0.2, 12, "soil").placed((0, -5, 0))
    tree = primitives.tree(2.0, 1.5, leaf="leaf", bark="soil", leaves=5)
    scene = SolidScene("hidden", (SOIL, LEAF), (wall, tree))
    assert not len(scene.volumes(scene.target(0.125), (0.0, -100.0, 5.0)))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: SolidScene("none", (METAL,), ()),
        lambda: SolidScene("twice", (METAL, METAL), (primitives.container("metal"),)),
        lambda: SolidScene("unknown", (METAL,), (primitives.container("wood"),)),
        lambda: primitives.ground(4, 4, "soil", hole_m=(-3, 1, -1, 1)),
        lambda: primitives.tree(0.0, 1.0, leaf="leaf", bark="soil"),
        lambda: warehouse(1e6),
        lambda: warehouse(finish="matt"),  # type: ignore[arg-type]
    ],
)
def test_impossible_scenes_are_refused(wrong) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(DataError):
        wrong()


def test_echoes_come_apart_by_mechanism() -> None:
    """A container on rough soil: a double bounce of theory's size, ground of its backscatter, no volume."""
    ground = primitives.ground(24, 24, "soil")
    scene = SolidScene("yard", (METAL, SOIL), (ground, primitives.container("metal")))
    sweep = Sweep(2.4e9, 80e6, 64)
    track = straight_track((0, -200, 200), 2.0, 3)
    found = simulate_radar(scene, RadarLook(track, (0, 0, 0), sweep, Density(0.2, 3, 3), points_per_m2=5.0))
    assert set(found.histories) == set(MECHANISMS)
    assert not np.any(found.histories["multiple"].echoes)
    total = sum(found.histories[name].echoes for name in MECHANISMS)
    np.testing.assert_allclose(found.total.echoes, total, atol=1e-12)
    # sqrt(4 pi) 2 w h cos 45 / lambda times Fresnel's R of the soil, weakened by Rayleigh's factor (10 mm rough), HH.
    echo = float(np.abs(found.histories["double"].echoes[0, 1]).max()) * (200**2 + 200**2)
    n = np.sqrt(11 - 3j - 0.5)
    r = abs((math.sqrt(0.5) - n) / (math.sqrt(0.5) + n))
    k = 2 * math.pi / sweep.wavelength_m
    fall = math.exp(-2 * (k * 0.01) ** 2 * 0.5)
    length, _, height = primitives.CONTAINER_M
    expected = math.sqrt(4 * math.pi) * 2 * length * height * math.sqrt(0.5) / sweep.wavelength_m * r * fall
    # 283 m are near for a face of 6 m (2 D^2 / lambda = 590 m): wavefronts bend along the fold.
    x = np.linspace(-length / 2, length / 2, 2001)
    expected *= abs(np.mean(np.exp(-1j * k * x**2 / math.hypot(200, 200))))
    assert 20 * math.log10(echo / expected) == pytest.approx(0.0, abs=0.3)
    # Four faces and the ground: no other bounce is as strong by 30 dB.
    assert found.beyond_db < -30


def test_the_yard_in_both_eyes_lies_on_one_grid() -> None:
    """A container alone: the radar's brightest line is its foot, the camera's bright face begins there."""
    white = Substance("white", CONDUCTOR, Lambert(0.8))
    # Smooth: at 15 GHz a roughness of 10 mm leaves nothing of the mirrored wave.
    smooth = Substance("soil", RadarSurface(11 - 3j), Lambert(0.1))
    scene = SolidScene("one", (white, smooth), (primitives.ground(24, 16, "soil"), primitives.container("white")))
    grid = ImageGrid(np.arange(-4, 4.1, 0.25), np.arange(-5, 5.1, 0.25), 0.0)
    how = Airborne(pulses=60, frequencies=128)
    radar = radar_picture(scene, grid, how, density=Density(0.2, 2, 2))
    row = int(np.argmax(np.sum(radar.powers[1], axis=1)))
    assert grid.y_m[row] == pytest.approx(-primitives.CONTAINER_M[1] / 2, abs=0.25)
    assert radar.powers[1].max() > 100 * radar.noise
    optics = optical_picture(scene, grid, sunlight(0.0, math.pi / 4), how, samples=20)
    middle = optics.s0[:, len(grid.x_m) // 2]
    # Seen at 45 degrees the face of 2.6 m covers as much ground behind its foot.
    assert np.nanmean(middle[(grid.y_m > 0) & (grid.y_m < 1)]) > 3 * np.nanmean(middle[grid.y_m < -2.5])
    # Lambert's surfaces do not polarize; what is left is noise of the sampling.
    assert np.nanmedian(optics.dolp) < 0.02
    above = bodies_from_above(scene, grid)
    assert set(np.unique(above)) == {0, 1}
    assert np.sum(above == 1) * 0.25**2 == pytest.approx(
        primitives.CONTAINER_M[0] * primitives.CONTAINER_M[1], rel=0.15
    )


def test_the_warehouse_is_whole() -> None:
    scene = warehouse()
    kinds = [solid.kind for solid in scene.solids]
    assert [kinds.count(kind) for kind in ("building", "container", "car", "tree", "person")] == [1, 6, 4, 6, 1]
    mesh, owner = scene.mesh()
    assert len(owner) == len(mesh)
    assert mesh.vertices_m[:, 2].min() >= 0
    scene.world([Sun((0.0, 0.0, 1.0))])
    with pytest.raises(DataError):
        Solid("x", "x", (Part(mesh, "none"),)) and SolidScene("x", (METAL,), (Solid("x", "x", (Part(mesh, "none"),)),))


@pytest.mark.parametrize(("finish", "least", "most"), [("ordinary", 0.0, 0.12), ("dark gloss", 0.25, 0.36)])
def test_what_polarizes_a_wall_is_gloss_over_dark_paint(finish: Finish, least: float, most: float) -> None:
    """The long wall of a container, seen at 45 degrees with the sun behind the camera, mirrors the yard before it.

    By hand, with irradiance 0.85 on the yard and 0.93 on the wall (sun, sky, and the yard's light): reflectances at 45
    degrees, n = 1.5, are 0.0920 and 0.0085: 0.95 x 0.0418 x 0.35 x 0.85 is polarized of 0.95 x 0.0502 x 0.35 x 0.85
    + 0.03 x 0.93, which is 0.28; the yard's own lobe, polarized the same way, adds a sixth to what is mirrored: 0.33.
    Over asphalt (albedo 0.1), half the gloss and twice the paint leave 0.03 + as much again by asphalt's larger lobe.
    """
    # The wall's foot is at y = -4.22; what is h high is seen h behind it.
    grid = ImageGrid(np.arange(-2.0, 2.1, 0.5), np.arange(-3.9, -2.0, 0.3), 0.0)
    optics = optical_picture(warehouse(finish=finish), grid, sunlight(0.0, np.pi / 4), samples=200)
    assert least < np.median(optics.dolp) < most
