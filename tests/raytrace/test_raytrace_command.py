"""The command ``raytrace``: scene files, meshes, products, figures, and what it says of mistakes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products import style
from polfuse_lab.products.store import Products
from polfuse_lab.raytrace.figures import composite
from polfuse_lab.raytrace.meshes import read_mesh
from polfuse_lab.raytrace.scene_file import SCENES, find_scene, read_scene
from processing.raytrace import bvh, embree, shapes

SCENE = """
[camera]
position_m = [0.0, 3.0, 2.0]
target_m = [0.0, 0.0, 0.3]
width_px = 12
height_px = 8

[trace]
bounces = 2
samples = 4

[[material]]
name = "foil"
kind = "fresnel"
n = 1.02
k = 6.84
slope_sd = 0.3

[[body]]
shape = "dihedral"
material = "foil"

[[source]]
kind = "point"
position_m = [0.5, 3.0, 2.5]
"""


def run(*arguments: str | Path) -> tuple[int, str, str]:
    result = CliRunner().invoke(build(), ["raytrace", *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


def test_a_scene_becomes_products_and_figures(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.replace("samples = 4", "samples = 4\nactive = true"))
    code, out, err = run(scene, "-o", tmp_path / "out.h5", "--json")
    assert code == 0, err
    told = json.loads(out)
    assert told["samples"] == 4
    assert told["rays"] > 12 * 8 * 4
    assert 0 < told["error"] < 1
    assert [Path(file).name for file in told["figures"]] == ["scene_stokes.png", "scene_active.png"]
    assert all(Path(file).stat().st_size > 10_000 for file in told["figures"])
    products = Products(tmp_path / "out.h5")
    arrays = products.read("raytrace")
    assert arrays["s0"].shape == (8, 12)
    assert arrays["mueller"].shape == (8, 12, 4, 4)
    # Unpolarized light: half of what both transmitters and both receivers let through together.
    whole = sum(arrays[name] for name in ("hh", "hv", "vh", "vv"))
    np.testing.assert_allclose(whole, 2 * arrays["s0"], rtol=1e-9, atol=1e-15)
    assert products.units("raytrace")["aop"] == "rad"
    assert products.settings("raytrace")["scene"]["material"][0]["n"] == 1.02


def test_pixels_without_light_are_grey_in_the_composite() -> None:
    # Black of S0 with half-way red and blue would be purple: a colour for what was not seen.
    stokes = np.zeros((2, 2, 4))
    stokes[0, 0] = (1.0, 0.5, 0.0, 0.0)
    colours = composite(stokes)
    np.testing.assert_allclose(colours[0, 0], [1.0, 1.0, 0.5])
    np.testing.assert_allclose(colours[1], float(style.UNDEFINED))


def test_forward_tracing_tells_of_what_it_cannot_show(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    smooth = SCENE.replace("slope_sd = 0.3", "slope_sd = 0.0")
    scene.write_text(smooth.replace("samples = 4", 'method = "forward"\nrays = 2000'))
    code, out, err = run(scene, "-o", tmp_path / "out.h5")
    assert code == 0, err
    assert "smooth surfaces do not show" in out


@pytest.mark.parametrize("name", sorted(path.stem for path in SCENES.glob("*.toml")))
def test_scenes_that_come_with_the_program_can_be_read(name: str) -> None:
    scene = read_scene(find_scene(name))
    assert len(scene.world(SCENES).sources) == len(scene.source)
    assert scene.title


@pytest.mark.parametrize("suffix", ["ply", "obj"])
def test_meshes_are_read_from_files(tmp_path: Path, suffix: str) -> None:
    pytest.importorskip("trimesh")
    ball = shapes.sphere(1.0, divisions=1)
    path = tmp_path / f"ball.{suffix}"
    if suffix == "ply":
        head = [
            "ply",
            "format ascii 1.0",
            f"element vertex {len(ball.vertices_m)}",
            *(f"property double {axis}" for axis in "xyz"),
            f"element face {len(ball)}",
            "property list uchar int vertex_indices",
            "end_header",
        ]
        lines = [*head, *(" ".join(map(repr, v)) for v in ball.vertices_m.tolist())]
        lines += [f"3 {i} {j} {k}" for i, j, k in ball.faces]
    else:
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in ball.vertices_m.tolist()]
        lines += [f"f {i + 1} {j + 1} {k + 1}" for i, j, k in ball.faces]
    path.write_text("\n".join(lines) + "\n")
    read = read_mesh(path)
    np.testing.assert_allclose(read.corners_m, ball.corners_m, atol=1e-7)
    scene = tmp_path / "scene.toml"
    body = f'shape = "file"\nfile = "ball.{suffix}"\nsize_m = 0.5'
    scene.write_text(SCENE.replace('shape = "dihedral"', body))
    world = read_scene(scene).world(tmp_path)
    assert len(world.material) == 80
    assert world.radius == pytest.approx(0.5 * ball.sphere[1], rel=1e-6)


def test_embree_finds_what_the_tree_finds() -> None:
    pytest.importorskip("embreex")
    mesh = shapes.rough_ground(10.0, 30, 0.3).moved((1e5, 0.0, 0.0))
    random = np.random.default_rng(0)
    aims = np.stack([1e5 + random.uniform(-6, 6, 500), random.uniform(-6, 6, 500), np.zeros(500)], axis=1)
    origin = np.tile([1e5, 0.0, 12.0], (500, 1))
    ours, theirs = bvh.build(mesh).closest(origin, aims - origin), embree.Embree(mesh).closest(origin, aims - origin)
    same = ours.triangle == theirs.triangle
    # float32 may choose the neighbour for a ray within 1e-6 of an edge.
    assert np.mean(same) > 0.99
    hit = same & (ours.triangle >= 0)
    assert np.mean(hit) > 0.5
    np.testing.assert_allclose(theirs.distance[hit], ours.distance[hit], rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("slope_sd = 0.3", "slope_sd = -0.3", "slope_sd"),
        ("slope_sd = 0.3", "slopes = 0.3", "slopes"),
        ('material = "foil"', 'material = "gold"', "there are foil"),
        ('shape = "dihedral"', 'shape = "file"', "give 'file'"),
        ('shape = "dihedral"', 'shape = "file"\nfile = "none.ply"', "no such mesh"),
        ('shape = "dihedral"', 'shape = "file"\nfile = "none.stl"', "give OBJ or PLY"),
        ('shape = "dihedral"', 'shape = "strips"', "5 strips need"),
        ("samples = 4", "samples = 4\nerror = 0.1", "not both"),
        ("target_m = [0.0, 0.0, 0.3]", "target_m = [0.0, 3.0, 2.0]", "no direction"),
        ('kind = "point"', 'kind = "point"\nstokes = [1.0, 1.0, 1.0, 0.0]', "state of polarization"),
        ("n = 1.02", "n = 1.02\ndiffuse = 0.5", "exceed 1"),
    ],
)
def test_mistakes_are_answered_in_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in SCENE
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.replace(old, new))
    code, _, err = run(scene, "-o", tmp_path / "out.h5")
    assert code == 1
    assert said in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "out.h5").exists()


def test_a_mesh_that_is_none(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    for suffix in ("ply", "obj"):
        path = tmp_path / f"bad.{suffix}"
        path.write_bytes(b"\x00\x01 not a mesh")
        with pytest.raises(PolfuseError):
            read_mesh(path)


def test_a_scene_that_is_not_there() -> None:
    with pytest.raises(PolfuseError, match="fig_4_13"):
        find_scene("fig_9_9")
