"""The command ``simulate``: scene files of bodies, what it writes for other commands, and what it says of mistakes."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.products.decompose import decompose
from polfuse_lab.products.fuse import fuse
from polfuse_lab.products.store import Products
from polfuse_lab.rig import parse_model
from polfuse_lab.simulation.scene_file import SolidSceneFile, read_solid_scene
from polfuse_lab.simulation.solid_parts import SolidPart
from processing.calibration.rcs import square_trihedral_amplitude
from processing.scattering.permittivity import permittivity
from processing.scattering.surfaces import RadarSurface
from processing.scene.warehouse import substances

YARD = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "yard.toml"
SPEED_OF_LIGHT = 299_792_458.0
EDGE_M = 0.6

# A trihedral above smooth ground beside a container. Pulses are 1.26 m apart, which repeats the scene after 17 m.
SCENE = f"""
[flight]
altitude_m = 1000.0
track_m = 160.0
pulses = 128

[radar]
centre_hz = 10e9
bandwidth_hz = 0.5e9
frequencies = 64
cell_m = 0.3
noise_equivalent_db = -60.0

[camera]
focal_length_m = 0.1
pixel_pitch_m = 18e-6
samples = 10

[grid]
width_m = 12.0
depth_m = 6.0
step_x_m = 0.1
step_y_m = 0.2

[[substance]]
name = "metal"
radar = "conductor"
kind = "lambert"
diffuse = 0.6

[[substance]]
name = "soil"
radar = "dielectric"
permittivity = [4.0, 0.1]
kind = "lambert"
diffuse = 0.1

[[solid]]
shape = "ground"
substance = "soil"
width_m = 13.0
depth_m = 7.0

[[solid]]
shape = "container"
substance = "metal"
size_m = [3.0, 1.0, 1.0]
position_m = [3.0, 1.0, 0.0]

[[solid]]
name = "reflector"
shape = "trihedral"
substance = "metal"
edge_m = {EDGE_M}
position_m = [-3.0, 0.0, 1.6]
"""


APP = build()


def run(*arguments: str | Path, command: str = "simulate") -> tuple[int, str, str]:
    result = CliRunner().invoke(APP, [command, *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("simulated")
    (folder / "scene.toml").write_text(SCENE)
    code, out, err = run(
        folder / "scene.toml", "-o", folder / "out.h5", "--figure", folder / "eyes.png", "--json"
    )  # fmt: skip
    assert code == 0, err
    return folder / "out.h5", json.loads(out)


def test_both_eyes_lie_on_one_grid(simulated: tuple[Path, dict[str, Any]]) -> None:
    path, told = simulated
    store = Products(path)
    assert store.stages() == ["matrices", "polarimetry", "simulation"]
    matrices, seen = store.read("matrices"), store.read("simulation")
    assert matrices["planes"].shape == (4, 31, 121) == (4, told["rows"], told["cols"])
    for arrays in (matrices, store.read("polarimetry"), seen):
        np.testing.assert_allclose(arrays["x_m"], np.linspace(-6, 6, 121), atol=1e-12)
        np.testing.assert_allclose(arrays["y_m"], np.linspace(-3, 3, 31), atol=1e-12)
    assert all(seen[name].shape == (31, 121) for name in ("s0", "dolp", "double_m2", "body"))
    bodies = store.settings("simulation")["bodies"]
    assert [body["name"] for body in bodies] == ["ground 1", "container 2", "reflector"]
    x, y = np.meshgrid(matrices["x_m"], matrices["y_m"])
    # The container's own rectangle, but for pixels at its edges.
    inside = (np.abs(x - 3) < 1.45) & (np.abs(y - 1) < 0.45)
    assert np.all(seen["body"][inside] == 1)
    # Light: white bodies of 0.6 on ground of 0.1, and Lambert's law leaves no polarization.
    roof = (np.abs(x - 3) < 1) & (np.abs(y - 2) < 0.15)  # the roof at 1 m shows 1 m further away from 45 degrees
    open_ground = (np.abs(x) < 1) & (y < -1)
    assert np.median(seen["s0"][roof]) == pytest.approx(6 * np.median(seen["s0"][open_ground]), rel=0.15)
    assert np.nanmedian(seen["dolp"]) < 0.05
    assert Path(told["figure"]).stat().st_size > 20_000
    assert len(store.provenance("simulation")["inputs"]) == 1


def test_a_trihedral_has_its_size_in_the_focused_picture(simulated: tuple[Path, dict[str, Any]]) -> None:
    """Thesis 5.5, its axis towards the track and the radar 45 degrees above."""
    arrays = Products(simulated[0]).read("matrices")
    hh, hv, _, vv = arrays["planes"]
    # The track runs 1000 m above and before the origin: a corner 1.6 m up and ground 1.6 m nearer are equally far.
    near = np.hypot(arrays["x_m"][None] + 3, arrays["y_m"][:, None] + 1.6) < 0.5
    row, column = np.unravel_index(np.argmax(np.where(near, np.abs(hh), 0)), hh.shape)
    assert (arrays["x_m"][column], arrays["y_m"][row]) == pytest.approx((-3.0, -1.6))
    expected = square_trihedral_amplitude(EDGE_M, math.pi / 4, math.pi / 4, SPEED_OF_LIGHT / 10e9)
    assert 20 * math.log10(abs(hh[row, column]) / float(expected)) == pytest.approx(0.0, abs=0.3)
    assert abs(vv[row, column] / hh[row, column] - 1) < 0.05
    assert abs(hv[row, column] / hh[row, column]) < 0.03


def test_decompositions_read_it_on_the_ground(simulated: tuple[Path, dict[str, Any]]) -> None:
    path, _ = simulated
    made = decompose(path, "pauli")
    store = Products(path)
    found, pauli = store.read(made.stage), store.read("polarimetry")["pauli"]
    np.testing.assert_array_equal(found["x_m"], store.read("matrices")["x_m"])
    np.testing.assert_allclose(found["odd_bounce"], np.abs(pauli[0]) ** 2, rtol=1e-4, atol=1e-9)
    # A region in metres: the trihedral alone.
    signature = decompose(path, "signature", region=(-3.2, -2.8, -1.8, -1.4))
    assert signature.planes


def test_both_eyes_are_fused_by_the_bodies(simulated: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    path = Path(shutil.copy(simulated[0], tmp_path / "out.h5"))
    options = ("--dynamic-range-db", "90", "--classifier", "likelihood", "--refine", "--json")
    code, out, err = run(path, *options, command="fuse")
    assert code == 0, err
    told = json.loads(out)
    assert (told["registration"], told["registration_error_px"], told["registration_shift_px"]) == ("identity", 0, None)
    assert any("identity" in note for note in told["notes"])
    assert any("to refine" in note for note in told["notes"])
    # The trihedral covers a few pixels only.
    assert set(told["regions"]) == {"ground", "container"}
    assert any("trihedral" in note for note in told["notes"])
    assert set(told["bhattacharyya"]) == {"ground - container"} == set(told["bayes_bounds"])
    assert told["confusion"]["names"] == ["ground", "container"]
    store = Products(path)
    fused, seen = store.read("fusion"), store.read("simulation")
    defined = np.isfinite(fused["features"][0])
    assert defined.sum() == told["pixels"] == sum(item["pixels"] for item in told["classes"].values())
    # One grid: what the camera saw is passed on as it is, and a pixel is its own place.
    np.testing.assert_array_equal(fused["features"][3][defined], seen["dolp"][defined])
    np.testing.assert_array_equal(fused["s0_on_ground"], seen["s0"])
    assert (fused["u_px"][7, 60], fused["v_px"][7, 60]) == (60, 7)
    assert store.units("fusion")["s0_on_ground"] == "1"
    # As light's mean over the container's pixels says.
    inside = defined & (seen["body"] == 1)
    assert told["regions"]["container"]["pixels"] == inside.sum()
    assert told["regions"]["container"]["mean"]["DOLP"] == pytest.approx(float(seen["dolp"][inside].mean()), rel=1e-4)
    assert all(Path(figure).stat().st_size > 10_000 for figure in told["figures"])
    regions = tmp_path / "regions.toml"
    patch = '[[region]]\nname = "{}"\npolygon_m = [[{}, -2.5], [{}, -2.5], [{}, 2.5], [{}, 2.5]]\n'
    regions.write_text(patch.format("west", -6, -1, -1, -6) + patch.format("east", 1, 6, 6, 1))
    found = fuse(path, regions=regions, dynamic_range_db=90)
    assert list(found.pairs) == ["west - east"]


def test_it_tells_what_was_left_out(simulated: tuple[Path, dict[str, Any]]) -> None:
    path, told = simulated
    left = told["left_out"]
    assert left["bounces"] == 3
    assert left["next_bounce_db"] < -20
    assert 0 <= left["parted"] < 0.2
    # The ground's footprints are 0.3 by 0.42 m: k (s/2)^2 / 2 (1/d + 1/d) at their corners, 1.4 km away. On the
    # container's ends, seen nearly edge-on, they are longer.
    assert left["wavefront_rad"] > 0.9 * 2 * math.pi * 10e9 / SPEED_OF_LIGHT * 3 * 0.3**2 / 4 / 1414
    assert "diffraction by edges" in left["not_modelled"]
    assert told["notes"] == []
    assert Products(path).settings("simulation")["left_out"] == left


def test_coarse_simulations_are_told(tmp_path: Path) -> None:
    # Two pulses 160 m apart repeat the scene every 0.03 x 1414 / 320 = 0.13 m.
    scene = tmp_path / "scene.toml"
    coarse = SCENE.replace("pulses = 128", "pulses = 2").replace("cell_m = 0.3", "cell_m = 3.0\nlevels = 0")
    scene.write_text(coarse.replace("step_y_m = 0.2", "step_y_m = 1.0").replace("samples = 10", "samples = 1"))
    code, out, err = run(scene, "-o", tmp_path / "out.h5")
    assert code == 0, err
    for said in ("every 0.132 m along the track", "grid.step_y_m", "not modelled", "bounce 4 at"):
        assert said in out


def test_a_measurement_is_not_replaced(tmp_path: Path) -> None:
    store = Products(tmp_path / "day.h5")
    store.write("focus", {"image": np.zeros((4, 2, 2))}, settings={}, inputs=[], units={})
    (tmp_path / "scene.toml").write_text(SCENE)
    code, _, err = run(tmp_path / "scene.toml", "-o", store.path)
    assert (code, store.stages()) == (1, ["focus"])
    assert "holds a measurement" in err


BODIES = {
    "plate": "width_m = 2.0\ntilt_deg = 90.0\nposition_m = [0.0, 0.0, 1.0]",
    "dihedral": "edge_m = 1.0",
    "trihedral": "edge_m = 1.0",
    "sphere": "diameter_m = 1.0\ndivisions = 1",
    "mesh": 'file = "roof.obj"\nunit_m = 0.5',
    "ground": "width_m = 3.0\ndepth_m = 3.0\nhole_m = [-1.0, 1.0, -1.0, 1.0]",
    "box": "width_m = 1.0\ndepth_m = 2.0\nheight_m = 3.0",
    "building": 'wall = "metal"\nroof = "soil"\ndoor = "metal"\nwidth_m = 6.0\ndepth_m = 3.0\nheight_m = 3.0',
    "container": "",
    "car": 'body = "metal"\nglass = "soil"',
    "tree": 'leaf = "soil"\nbark = "soil"\ncrown_m = 1.0\ntrunk_m = 1.0',
    "person": "",
}
"""What each shape needs besides its substance."""
HEAD = SCENE[: SCENE.index("[[solid]]")]
OWN_SUBSTANCES = ("building", "car", "tree")


def file_of(shape: str) -> str:
    substance = "" if shape in OWN_SUBSTANCES else 'substance = "metal"\n'
    return f'{HEAD}[[solid]]\nshape = "{shape}"\nturn_deg = 30.0\n{substance}{BODIES[shape]}\n'


def test_every_shape_is_tried() -> None:
    shapes = {part.model_fields["shape"].default for part in get_args(get_args(SolidPart)[0])}
    assert set(BODIES) == shapes


@pytest.mark.parametrize("shape", BODIES)
def test_bodies_of_files_stand_on_the_ground(tmp_path: Path, shape: str) -> None:
    if shape == "mesh":
        pytest.importorskip("trimesh")
        (tmp_path / "roof.obj").write_text("v 0 0 0\nv 2 0 0\nv 2 2 2\nv 0 2 2\nf 1 2 3\nf 1 3 4\n")
    path = tmp_path / "scene.toml"
    path.write_text(file_of(shape))
    given = read_solid_scene(path)
    (solid,) = given.scene(path).solids
    assert (solid.name, solid.kind) == (f"{shape} 1", shape)
    corners = np.concatenate([part.mesh.corners_m.reshape(-1, 3) for part in solid.parts])
    assert np.all(np.isfinite(corners))
    # Cars have free air below and spheres are icosahedra: within 0.2 m of the ground, and not in it.
    assert 0.0 <= corners[:, 2].min() + 1e-9 < 0.2 + 1e-6
    if shape in ("dihedral", "trihedral"):  # open towards the track, turned by 30 degrees from -y towards +x
        middle = corners.mean(axis=0)
        assert math.degrees(math.atan2(middle[0], -middle[1])) == pytest.approx(30.0, abs=1e-6)
    if shape == "plate":
        assert corners[:, 2].max() == pytest.approx(2.0)
    if shape == "mesh":
        assert corners[:, 2].max() == pytest.approx(1.0)
        assert given.files(tmp_path) == [tmp_path / "roof.obj"]


def test_the_example_is_of_the_warehouses_stuff() -> None:
    given = read_solid_scene(YARD)
    scene = given.scene(YARD)
    assert {solid.kind for solid in scene.solids} >= {"building", "container", "car", "tree", "person", "trihedral"}
    known = {substance.name: substance for substance in substances(15e9)}
    for substance in scene.substances:
        if substance.name in ("asphalt", "grass", "glass", "leaves", "bark", "clothing"):
            assert (substance.radar, substance.optical) == (
                known[substance.name].radar,
                known[substance.name].optical,
            )
    brick = next(substance for substance in scene.substances if substance.name == "brick")
    assert brick.radar == RadarSurface(permittivity("brick", 15e9), 0.002)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('radar = "conductor"', 'radar = "iron"', "found 'iron', allowed: conductor, passed, dielectric, concrete"),
        ('radar = "conductor"', 'radar = "dielectric"', "give 'permittivity'"),
        ("permittivity = [4.0, 0.1]", "permittivity = [0.5, 0.1]", "e' of 1 or more"),
        ("permittivity = [4.0, 0.1]", "permitivity = [4.0, 0.1]", "did you mean 'permittivity'?"),
        ('shape = "container"', 'shape = "contaner"', "contaner"),
        (f"edge_m = {EDGE_M}", "", "edge_m: found nothing"),
        (f"edge_m = {EDGE_M}", "edge_m = -1.0", "greater than 0"),
        (f"edge_m = {EDGE_M}", f"edge = {EDGE_M}", "did you mean 'edge_m'?"),
        ('substance = "soil"', 'substance = "sand"', "solid 1 (ground) is of 'sand', there are metal, soil"),
        ('name = "soil"', 'name = "metal"', "same name"),
        ("width_m = 13.0", "width_m = 13.0\nhole_m = [-20.0, 1.0, -1.0, 1.0]", "solid 1 (ground)"),
        ("diffuse = 0.6", 'diffuse = 0.6\n[[substance]]\nname = "x"\nradar = "passed"\nkind = "ward"\ndiffuse = 0.6',
         "substance 2 (x)"),
        ("width_m = 12.0", "width_m = 12e4", "pixels at most"),
        ("focal_length_m = 0.1", "focal_length_m = 1e3", "pixels of the camera at most"),
        ("frequencies = 64", "frequencies = 63", "an even number"),
        ("frequencies = 64", "frequencies = 8", "frequencies or more"),
        ("bandwidth_hz = 0.5e9", "bandwidth_hz = 30e9", "less than twice"),
        ("altitude_m = 1000.0", "altitude_m = nan", "finite"),
    ],
)  # fmt: skip
def test_mistakes_are_answered_in_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in SCENE
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.replace(old, new, 1))
    code, _, err = run(scene, "-o", tmp_path / "out.h5")
    assert code == 1
    assert said in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "out.h5").exists()


def test_a_mistake_has_its_line() -> None:
    text = SCENE.replace(f"edge_m = {EDGE_M}", "edge_m = 0.0")
    line = text.splitlines().index("edge_m = 0.0") + 1
    with pytest.raises(Exception, match=rf"line {line}, solid\.2\.trihedral\.edge_m: found 0\.0"):
        parse_model(text, SolidSceneFile, "scene.toml")
