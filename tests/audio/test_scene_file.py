"""Scene files: units, and every mistake answered with file, line, field, found and allowed."""

from __future__ import annotations

import cmath
import math
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from hw_mocks.scene_file import load_scene, load_scene_file
from polfuse_lab.errors import PolfuseError
from processing.scene.radar_response import reflector_scattering, scatterers

FIELD = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "field.toml"


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return path


def test_units_and_conveniences(tmp_path: Path) -> None:
    text = """
    name = "units"
    seed = 7
    [front_end]
    noise = 0.02
    [front_end.receive]
    imbalance_db = 6.0
    imbalance_deg = 30.0
    crosstalk_db = -20.0
    crosstalk_deg = 90.0
    [front_end.transmit]
    imbalance_db = -6.0
    crosstalk_db = -40.0
    [sun]
    azimuth_deg = 90.0
    elevation_deg = 30.0
    counts = 1000.0
    [[point]]
    name = "a"
    position_m = [1, 2, 3]
    rcs_dbsm = 20.0
    [[point]]
    name = "b"
    position_m = [1, 2, 3]
    scattering = [[[1, 2], [3, 4]], [[5, 6], [7, 8]]]
    [[point]]
    name = "c"
    position_m = [1, 2, 3]
    scattering_dbsm = [[0, -20], [-20, 6]]
    scattering_deg = [[0, 90], [90, 180]]
    [[reflector]]
    name = "d"
    kind = "dihedral"
    position_m = [0, 9, -1]
    edge_m = 0.5
    azimuth_deg = 10.0
    fold_deg = 90.0
    [[bush]]
    name = "e"
    position_m = [0, 12, -1]
    radius_m = 0.5
    rcs_dbsm = 10.0
    [[surface]]
    name = "f"
    corner_m = [0, 9, -1]
    edge_u_m = [1, 0, 0]
    edge_v_m = [0, 0, 1]
    s0 = 0.5
    dolp = 0.4
    aop_deg = 45.0
    """
    scene = load_scene(written(tmp_path, text))
    a, b, c = (point.scattering for point in scene.points)
    # 20 dBsm is 100 m^2, amplitude 10 m.
    np.testing.assert_allclose(a, 10 * np.eye(2))
    np.testing.assert_array_equal(b, [[1 + 2j, 3 + 4j], [5 + 6j, 7 + 8j]])
    np.testing.assert_allclose(c, [[1, 0.1j], [0.1j, -(10**0.3)]], atol=1e-15)
    assert scene.reflectors[0].fold_rad == pytest.approx(math.pi / 2)
    assert scene.reflectors[0].azimuth_rad == pytest.approx(math.radians(10))
    assert scene.bushes[0].rcs_m2 == pytest.approx(10)
    # All polarized light at +45 degrees is S2.
    np.testing.assert_allclose(scene.surfaces[0].stokes, [0.5, 0, 0.2], atol=1e-16)
    np.testing.assert_allclose(scene.sun_direction, [math.sqrt(3) / 2, 0, 0.5], atol=1e-15)
    gain = cmath.rect(10**0.3, math.radians(30))
    np.testing.assert_allclose(scene.front_end.receive, [[1, 0.1j], [0.1j * gain, gain]], atol=1e-15)
    np.testing.assert_allclose(scene.front_end.transmit, [[1, 0.01 / 10**0.3], [0.01, 1 / 10**0.3]], atol=1e-15)
    assert (scene.seed, scene.front_end.noise) == (7, 0.02)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[[point]]\nname = "a"\nposition_m = [0, 9, 0]', ["line 1", "point.0", "exactly one of rcs_dbsm"]),
        ('[[surface]]\nname = "a"\ncorner_m = [0, 0, 0]\nedge_u_m = [1, 0, 0]\nedge_v_m = [0, 1, 0]\n'
         's0 = 1\ndolp = 1.5',
         ["line 7", "surface.0.dolp", "1.5", "less than or equal to 1"]),
        ("[front_end]\nnoize = 0.1", ["line 2", "noize", "did you mean 'noise'"]),
        ("[audio]\nsweep_period_samples = 1920.3", ["audio", "whole number of samples"]),
        ("[audio]\nsweep_period_samples = 900.0", ["longer than waveform.ramp_up_s"]),
        ('[[reflector]]\nname = "p"\nkind = "plate"\nposition_m = [0, 9, 0]\nedge_m = 1\nfold_deg = 90',
         ["'p'", "fold_deg on a plate"]),
        ("[[point]\n", ["not valid TOML", "line 1"]),
    ],
)  # fmt: skip
def test_mistakes_are_named(tmp_path: Path, text: str, words: list[str]) -> None:
    path = written(tmp_path, text)
    with pytest.raises(PolfuseError) as caught:
        load_scene(path)
    for word in [str(path), *words]:
        assert word in str(caught.value)


def test_a_missing_scene_is_named(tmp_path: Path) -> None:
    with pytest.raises(PolfuseError, match=r"none\.toml"):
        load_scene(tmp_path / "none.toml")


def test_the_example_scene_keeps_what_it_promises() -> None:
    file, scene = load_scene_file(FIELD), load_scene(FIELD)
    wavelength = file.waveform.wavelength_m
    cell = 299_792_458 / (2 * file.waveform.bandwidth_hz)
    targets = [*scene.points, *scene.reflectors, *scene.bushes]
    for target in targets:
        distance = float(np.linalg.norm(target.position_m))
        bearing = math.degrees(math.atan2(target.position_m[0], target.position_m[1]))
        assert 6 <= distance <= 16
        assert abs(bearing) <= 25
        assert target.position_m[2] >= -file.geometry.antenna_height_m
    for one, other in combinations(targets, 2):
        near, far = sorted(float(np.linalg.norm(target.position_m)) for target in (one, other))
        # Well apart in cross range: ten cells of lambda R / 2 L, with L = 3.048 m.
        cross_cell = wavelength * far / (2 * 3.048)
        assert far - near > 2 * cell or abs(one.position_m[0] - other.position_m[0]) > 10 * cross_cell
    for reflector in scene.reflectors:
        # Far field of the reflector, 2 D^2 / lambda.
        assert np.linalg.norm(reflector.position_m) > 2 * reflector.edge_m**2 / wavelength
    levels = [10 * math.log10(abs(reflector_scattering(r, (0, 0, 0), wavelength)[0, 0]) ** 2) for r in scene.reflectors]
    levels += [file.point[0].rcs_dbsm, file.bush[0].rcs_dbsm]  # type: ignore[list-item]
    assert max(levels) - min(levels) < 25
    # Sum of all echoes, co-polarized: no clipping.
    centres, matrices = scatterers(scene, (0, 0, 0), wavelength)
    voltages = np.abs(matrices[:, 0, 0]) / np.linalg.norm(centres, axis=1) ** 2 * file.front_end.amplitude_at_1m
    assert voltages.sum() + file.front_end.coupling + 6 * file.front_end.noise < 0.95
