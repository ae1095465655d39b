"""Scene files of bodies drive the simulated rig: beats against reflectors in closed form, a collect over wires."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hw_mocks.rig import SimulatedRig
from hw_mocks.rig_bodies import Seen, look_at
from hw_mocks.scene_file import SceneFile, load_scene_file
from hw_mocks.sound_card import Synthesizer
from hw_mocks.world import World
from polfuse_lab.engine import collect
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus import focus
from polfuse_lab.products.optics import optics
from polfuse_lab.products.store import Products
from polfuse_lab.simulation.rig_scene import read_bodies
from polfuse_lab.simulation.scene_file import read_solid_scene
from processing.radar.antenna import boresight, one_way_gain
from processing.radar.beat import TriangleFm, beat_of_ranges
from processing.scene.model import FrontEnd, Reflector, Scene

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "field_of_bodies.toml"
HEIGHT_M, EDGE_M, AWAY_M, UP_M = 1.069, 0.61, 40.0, 0.6
DOWN_DEG = math.degrees(math.atan2(HEIGHT_M - UP_M, AWAY_M))
K = 2 * math.pi * 2.4e9 / 299_792_458

HEAD = """\
[geometry]
antenna_height_m = 1.069
[rail]
length_m = 0.1
[front_end]
amplitude_at_1m = 50.0
"""
METAL = """\
[[substance]]
name = "metal"
radar = "conductor"
kind = "lambert"
diffuse = 0.5
"""


def solid(shape: str, size: str, tilt_deg: float, place: tuple[float, float, float]) -> str:
    return (
        f'[[solid]]\nshape = "{shape}"\nsubstance = "metal"\n{size} = {EDGE_M}\n'
        f"tilt_deg = {tilt_deg}\nposition_m = {list(place)}\n"
    )


def written(path: Path, *parts: str) -> Path:
    path.write_text("".join(parts))
    return path


def seen(path: Path) -> tuple[SceneFile, Seen]:
    file = load_scene_file(path)
    return file, look_at(file, read_bodies(path, file.waveform.centre_hz), where=str(path))


def cycle(file: SceneFile, scene: Scene, x_m: float, pol: str, found: Seen | None = None) -> np.ndarray:
    """A cycle of the beat, without noise, fractions of full scale."""
    world = World()
    world.trolley_x_m.hold(x_m, 1)
    world.transmit.set(pol, 1)
    world.receive.set(pol, 1)
    echoes = None if found is None else found.echoes
    card = Synthesizer(scene, file.waveform, file.geometry, file.audio, world, 1, echoes)
    return card.block(0, file.audio.cycle_samples, 10**12)[:, 0] / 32_767


APART = """\
[geometry]
antenna_height_m = 1.069
[geometry.phase_centres]
transmit_v_m = [0.1, 0.0, 0.2]
receive_h_m = [-0.3, 0.0, 0.0]
receive_v_m = [0.0, 0.05, -0.1]
[rail]
length_m = 0.1
[front_end]
amplitude_at_1m = 0.5
noise = 0.0
[[point]]
name = "one"
position_m = [1.0, 6.0, -0.6]
scattering = [[[1.0, 0.0], [0.5, 0.2]], [[0.5, 0.2], [-2.0, 0.0]]]
[[point]]
name = "two"
position_m = [-2.0, 14.0, -0.3]
scattering = [[[-3.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 4.0]]]
"""


@pytest.mark.parametrize("channel", ["HH", "HV", "VH", "VV"])
def test_points_beat_by_the_way_from_one_antenna_to_the_other(tmp_path: Path, channel: str) -> None:
    """Against the closed form of each path, there and back from antennas that are apart."""
    file = load_scene_file(written(tmp_path / "scene.toml", APART))
    world = World()
    world.trolley_x_m.hold(0.03, 1)
    world.transmit.set(channel[0], 1)
    world.receive.set(channel[1], 1)
    found = look_at(file)
    card = Synthesizer(found.scene, file.waveform, file.geometry, file.audio, world, 1, found.echoes)
    told = card.block(0, file.audio.cycle_samples, 10**12)[:, 0] / 32_767
    centres = file.geometry.phase_centres
    assert centres is not None
    sent = {"H": centres.transmit_h_m, "V": centres.transmit_v_m}[channel[0]]
    received = {"H": centres.receive_h_m, "V": centres.receive_v_m}[channel[1]]
    axis, width = (
        boresight(math.radians(file.geometry.antenna_elevation_deg)),
        math.radians(file.geometry.beamwidth_deg),
    )
    ranges, amplitudes = [], []
    for point in found.scene.points:
        ways = [np.array(point.position_m) - np.array([0.03, 0, 0]) - end for end in (sent, received)]
        lengths = [float(np.linalg.norm(way)) for way in ways]
        gains = [math.sqrt(float(one_way_gain(w @ axis / r, width))) / r for w, r in zip(ways, lengths, strict=True)]
        rx, tx = "HV".index(channel[1]), "HV".index(channel[0])
        ranges.append(sum(lengths) / 2)
        amplitudes.append(0.5 * np.array(point.scattering).reshape(2, 2)[rx, tx] * math.prod(gains))
    count = file.audio.cycle_samples
    sweep = TriangleFm(2.4e9, 80e6, 0.02, file.audio.sweep_period_samples / file.audio.sample_rate_hz)
    since = (np.arange(count) * file.audio.noise_cycle % count) / (file.audio.noise_cycle * file.audio.sample_rate_hz)
    exact = beat_of_ranges(*sweep.frequency(since), ranges, np.array(amplitudes))
    # Half a count, and the residual video phase at the bins' delays (6e-5).
    np.testing.assert_allclose(told, exact, atol=0.6 / 32_767 + 1e-4 * np.abs(amplitudes).max())


@pytest.mark.parametrize(
    ("shape", "size", "tilt_deg", "reflector", "signs", "spread"),
    [
        # Looking at the antennas. A closed form has no sign of its own: three mirrors return the field as it came and
        # a plate reverses it; a dihedral returns H as it came and reverses V. Spread: mean square distance from the
        # middle of the opening (a hexagon, a rectangle of sqrt(2) a, a square), in squares of the edge.
        ("trihedral", "edge_m", 35.264 - DOWN_DEG, Reflector("t", "trihedral", (0.0, AWAY_M, UP_M - HEIGHT_M), EDGE_M,
         math.radians(45), math.radians(35.264)), (-1, -1), 5 / 18),
        ("dihedral", "edge_m", 45 - DOWN_DEG, Reflector("d", "dihedral", (0.0, AWAY_M, UP_M - HEIGHT_M), EDGE_M),
         (-1, -1), 1 / 4),
        ("plate", "width_m", 90 - DOWN_DEG, Reflector("p", "plate", (0.0, AWAY_M, UP_M - HEIGHT_M), EDGE_M),
         (1, 1), 1 / 6),
    ],
)  # fmt: skip
def test_bodies_beat_as_reflectors_of_their_size(
    tmp_path: Path, shape: str, size: str, tilt_deg: float, reflector: Reflector, signs: tuple[int, int], spread: float
) -> None:
    file, found = seen(
        written(tmp_path / "scene.toml", HEAD, METAL, solid(shape, size, tilt_deg, (0, AWAY_M, UP_M)))
    )  # fmt: skip
    for pol, sign in zip("HV", signs, strict=True):
        for x_m in (-0.05, 0.03):
            # In phase and a quarter of a turn on: a beat is a sum of both.
            ends = [FrontEnd(turn * np.eye(2), amplitude_at_1m=50.0) for turn in (1, 1j)]
            flat = [cycle(file, Scene("flat", reflectors=(reflector,), front_end=end), x_m, pol) for end in ends]
            body = cycle(file, found.scene, x_m, pol, found)
            parts, rest, *_ = np.linalg.lstsq(np.stack(flat, axis=1), body, rcond=None)
            ratio = complex(*parts) * sign
            # Physical optics at five wavelengths: 0.3 dB (edges of the faces, and 1 % by rays at them).
            assert 20 * math.log10(abs(ratio)) == pytest.approx(0.0, abs=0.3)
            # 40 m are not quite far: wavefronts bend by k <r^2> / R over the opening, 4 to 8 degrees.
            assert math.degrees(np.angle(ratio)) == pytest.approx(
                -math.degrees(K * spread * EDGE_M**2 / AWAY_M), abs=1.0
            )  # fmt: skip
            # Nothing else is in it: 2 % of the amplitude, from the single bounces of a corner's faces.
            assert math.sqrt(float(rest[0]) / np.sum(flat[0] ** 2)) < 0.03


RIG = f"""\
seed = 3
[geometry]
antenna_height_m = {HEIGHT_M}
[rail]
length_m = 0.4
speed_m_s = 1.0
[front_end]
amplitude_at_1m = 1.0
noise = 0.002
[camera]
width_px = 48
height_px = 32
focal_length_m = 0.008
pixel_pitch_m = 1.3e-4
depression_deg = 5.0
[sun]
counts = 20000.0
[rays]
levels = 3
samples = 16
[[substance]]
name = "dark paint"
radar = "conductor"
kind = "fresnel"
n = 1.5
specular = 0.95
diffuse = 0.02
"""
PLAN = """\
aperture_m = 0.3048
step_m = 0.0508
channels = ["HH"]
sweeps_per_channel = 2
move_settle_s = 0.0
[optics]
frames_per_angle = 1
settle_s = 0.0
"""


def test_a_collect_over_wires_finds_bodies_with_both_eyes(tmp_path: Path) -> None:
    scene = written(
        tmp_path / "scene.toml",
        RIG,
        METAL,
        solid("trihedral", "edge_m", 32.0, (0.8, 8.6, 0.6)),
        solid("dihedral", "edge_m", 42.0, (-2.0, 12.0, 0.5)),
        # Flat: its light is the sky's, mirrored at 5 degrees above the paint.
        '[[solid]]\nshape = "plate"\nsubstance = "dark paint"\nwidth_m = 6.0\nposition_m = [0.0, 10.0, 0.0]\n',
    )
    bodies = read_bodies(scene, 2.4e9)
    with SimulatedRig(scene, tmp_path / "rig", audio="tcp", bodies=bodies) as rig:
        collect(rig.write_rig(), written(tmp_path / "plan.toml", PLAN), tmp_path / "s.h5")
        rig.check()
        picture = rig.picture
    focus(tmp_path / "s.h5", tmp_path / "p.h5", method="bp", window="hann")
    found = Products(tmp_path / "p.h5").read("focus")
    near = (np.abs(found["x_m"]) < 4)[None] & (np.abs(found["y_m"] - 8.6) < 2)[:, None]
    row, column = np.unravel_index(np.argmax(np.where(near, np.abs(found["image"][0]), 0)), near.shape)
    # Half a cell: lambda R / 2 L along the rail, c / 2 B on the ground.
    assert found["x_m"][column] == pytest.approx(0.8, abs=0.125 * 8.6 / (2 * 0.356) / 2)
    assert found["y_m"][row] == pytest.approx(8.6, abs=1.874 / 2)
    optics(tmp_path / "s.h5", tmp_path / "p.h5")
    seen = Products(tmp_path / "p.h5").read("optics")
    # What the camera measured is what was traced: shot noise of 20000 counts at full light.
    truth = picture[0] * 20_000
    bright = truth > 500
    assert np.median(np.abs(seen["s0"][bright] / truth[bright] - 1)) < 0.03
    dolp = np.hypot(picture[1], picture[2]) / np.maximum(picture[0], 1e-9)
    assert np.median(np.abs(seen["dolp_raw"][bright] - dolp[bright])) < 0.03
    assert float(dolp[bright].max()) > 0.3


POINT = '[[point]]\nname = "p"\nposition_m = [0, 9, 0]\nrcs_dbsm = 0.0\n'
BODY = METAL + solid("plate", "width_m", 90.0, (0.0, 9.0, 0.5))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BODY + POINT, ["either bodies (solid, substance)", "(point)", "not both"]),
        (BODY + "[sun]\nbackground_s0 = 0.1\n", ["sun.background_s0", "not both"]),
        (POINT + "[rays]\ncell_m = 0.2\n", ["(rays)", "(point)"]),
        (METAL, ["at least one [[substance]] and one [[solid]]"]),
        (BODY + "[flight]\naltitude_m = 100.0\n", ["flown over", "[flight]", "polfuse simulate"]),
        (BODY.replace("metal", "tin", 1), ["solid 1 (plate) is of 'metal'", "tin"]),
        (BODY.replace("width_m", "width"), ["width", "did you mean 'width_m'"]),
        (BODY + "velocity_m_s = [1.0, 0.0, 0.0]\n", ["velocity_m_s"]),
        (BODY + "[rays]\ncell_m = 0.001\n", ["rays.cell_m", "0.001", "0.01"]),
    ],
)
def test_mistakes_in_files_of_bodies_are_named(tmp_path: Path, text: str, words: list[str]) -> None:
    path = written(tmp_path / "scene.toml", text)
    with pytest.raises(PolfuseError) as caught:
        seen(path)
    for word in [str(path), *words]:
        assert word in str(caught.value)


def test_a_scene_of_the_rig_is_not_flown_over(tmp_path: Path) -> None:
    for text in (HEAD + BODY, POINT):
        with pytest.raises(PolfuseError, match=r"before the rig's rail.*polfuse sim'"):
            read_solid_scene(written(tmp_path / "scene.toml", text))


def test_bodies_must_be_handed_over_and_be_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path / "scene.toml", BODY)
    with pytest.raises(PolfuseError, match="read_bodies"):
        look_at(load_scene_file(path))
    other = written(tmp_path / "other.toml", POINT)
    with pytest.raises(PolfuseError, match="the file has none"):
        look_at(load_scene_file(other), read_bodies(path, 2.4e9))


def test_the_example_can_be_read() -> None:
    file = load_scene_file(EXAMPLE)
    names = [body.name for body in read_bodies(EXAMPLE, file.waveform.centre_hz).solids]
    assert names == ["ground 1", "trihedral", "dihedral", "plate", "bush", "car", "container", "tree"]
