"""A camera with a mosaic of polarizers, from the rig file to the stage: no polarizer turns, and the scene is found."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from optics_session import PITCH_M, RIG, SCENE, options, take, write_session
from typer.testing import CliRunner

from hw_mocks.scene_camera import SceneCamera
from hw_mocks.scene_file import load_scene
from hw_mocks.world import World
from hw_mocks.world_link import WorldServer
from polfuse_lab.cli import build
from polfuse_lab.products.optics import optics, series_of
from polfuse_lab.products.store import Products
from polfuse_lab.records import Exposure
from polfuse_lab.rig import FileMistake, Rig, parse_model
from processing.optics.camera_model import Pinhole
from processing.optics.demosaic import SAMPLES_PER_PIXEL
from processing.optics.regions import region_polarization
from processing.scene.optical import stokes_image

SIZE = (98, 74)
RATIO = 300.0


def mosaic_rig(name: str, *, height: int = SIZE[1], more: str = "") -> str:
    camera, _ = RIG.split("[polarizer]")
    extra = f'mosaic = "{name}"\nmosaic_extinction_ratio = {RATIO}\n{more}'
    return camera.replace("height_px = 73", f"height_px = {height}") + extra


def frames(scene: Path, name: str, count: int, seed: int) -> list[Exposure]:
    world = World()
    with WorldServer(world) as server:
        camera = SceneCamera(options(scene, server.url, seed, height_px=SIZE[1], mosaic=name, extinction_ratio=RATIO))
        try:
            camera.open()
            taken = []
            for index in range(count):
                # Wherever the rig's polarizer stands, it is not in this camera's way.
                world.polarizer_rad.hold(0.3 * index)
                taken.append(Exposure(take(camera), 0.0, 0.0))
            return taken
        finally:
            camera.close()


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(SCENE)
    return path


@pytest.mark.parametrize("name", ["90-45-135-0", "0-135-45-90", "45-90-0-135"])
def test_every_surface_has_its_polarization_in_each_phase(scene: Path, tmp_path: Path, name: str) -> None:
    path = write_session(tmp_path / "s.h5", frames(scene, name, 4, seed=3), rig=mosaic_rig(name))
    made = optics(path, tmp_path / "products.h5")
    assert made.frames == 4
    products = Products(made.products)
    arrays, settings = products.read("optics"), products.settings("optics")
    assert settings["mosaic"] == name
    assert arrays["s0"].shape == SIZE[::-1]
    world = load_scene(scene)
    pinhole = Pinhole(0.008, PITCH_M, *SIZE, (0.0, 0.0, 0.0), math.radians(9.0))
    truth, surfaces = stokes_image(world, pinhole)
    series = series_of(settings)
    assert series.samples_per_pixel == SAMPLES_PER_PIXEL
    for number in range(len(world.surfaces)):
        mask = surfaces == number
        for _ in range(2):
            # Two pixels from the edge: interpolation reaches one pixel, and none of the other surface's light counts.
            inner = mask.copy()
            for row in (-1, 0, 1):
                for column in (-1, 0, 1):
                    inner &= np.roll(mask, (row, column), (0, 1))
            mask = inner
        assert mask.sum() > 50
        s0, s1, s2 = (float(np.mean(plane[mask])) for plane in truth)
        region = region_polarization(arrays["s0"], arrays["s1"], arrays["s2"], mask, series)
        dolp, aop = math.hypot(s1, s2) / s0, 0.5 * math.atan2(s2, s1)
        assert abs(region.dolp - dolp) < 3 * region.dolp_sd
        assert abs(math.remainder(region.aop - aop, math.pi)) < 3 * region.aop_sd


def test_a_regions_error_is_its_scatter_from_run_to_run(scene: Path, tmp_path: Path) -> None:
    name = "90-45-135-0"
    found, told = [], []
    mask = np.zeros(SIZE[::-1], dtype=bool)
    mask[20:28, 20:30] = True
    for seed in range(40):
        path = write_session(tmp_path / f"{seed}.h5", frames(scene, name, 1, seed), rig=mosaic_rig(name))
        made = optics(path, tmp_path / f"{seed}_products.h5")
        region = region_polarization(made.image.s0, made.image.s1, made.image.s2, mask, made.series)
        found.append(region.dolp)
        told.append(region.dolp_random_sd)
    # A standard deviation from 40 runs is itself known to 11 %; counting pixels instead of samples would halve it.
    # The 80 pixels' planes also use the samples of the rim around them: up to a quarter more of them, 12 % in the sd.
    assert np.std(found, ddof=1) == pytest.approx(np.mean(told), rel=0.4)


def test_saturation_spreads_to_what_is_interpolated_from_it(scene: Path, tmp_path: Path) -> None:
    taken = frames(scene, "90-45-135-0", 1, seed=1)
    image = taken[0].frame.image.copy()
    image[31, 41] = 65_535
    object.__setattr__(taken[0].frame, "image", image)
    made = optics(write_session(tmp_path / "s.h5", taken, rig=mosaic_rig("90-45-135-0")), tmp_path / "products.h5")
    assert np.isnan(made.image.s0[30:33, 40:43]).all()
    assert np.isfinite(made.image.s0[29, 40])


def test_the_command_takes_a_mosaic_session(scene: Path, tmp_path: Path) -> None:
    path = write_session(tmp_path / "s.h5", frames(scene, "90-45-135-0", 2, 0), rig=mosaic_rig("90-45-135-0"))
    ran = CliRunner().invoke(build(), ["optics", str(path), "-o", str(tmp_path / "p.h5"), "--json"])
    assert ran.exit_code == 0, ran.output
    values = json.loads(ran.stdout)
    assert values["frames"] == 2
    assert values["angles_deg"] == pytest.approx([0, 45, 90, 135])
    # Four angles 45 degrees apart: columns of the matrix have norms 1, sqrt(1/2), sqrt(1/2), nearly.
    assert values["condition_number"] == pytest.approx(math.sqrt(2), rel=0.01)


def test_a_tolerance_chooses_the_demosaicer_and_the_product_says_why(scene: Path, tmp_path: Path) -> None:
    path = write_session(tmp_path / "s.h5", frames(scene, "90-45-135-0", 2, 0), rig=mosaic_rig("90-45-135-0"))
    words = ["optics", str(path), "-o", str(tmp_path / "p.h5")]
    ran = CliRunner().invoke(build(), [*words, "--tolerance=-3", "--json"])
    assert ran.exit_code == 0, ran.output
    assert "demosaicer bilinear: the cheapest within -3 dB" in json.loads(ran.stdout)["explanation"][0]
    settings = Products(tmp_path / "p.h5").settings("optics")
    assert (settings["demosaic"], settings["tolerance_db"], settings["tolerance_kept"]) == ("bilinear", -3.0, True)
    assert settings["predicted_error_db"] < -5
    made = optics(path, tmp_path / "p.h5", tolerance_db=-90.0)
    assert made.choice is not None
    assert "nothing on offer keeps -90 dB" in made.choice.explain()[0]
    settings = Products(tmp_path / "p.h5").settings("optics")
    assert not settings["tolerance_kept"]
    assert settings["predicted_error_db"] <= min(settings["considered"].values()) + 0.5
    for wrong in (["--tolerance=-30", "--demosaic", "newton"], ["--tolerance", "perfect"]):
        ran = CliRunner().invoke(build(), [*words, *wrong])
        assert ran.exit_code != 0
        assert "Traceback" not in ran.output


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (mosaic_rig("90-45-135-1"), "camera.mosaic: found '90-45-135-1'"),
        (mosaic_rig("90-45-135-0", height=73), "even"),
        (mosaic_rig("90-45-135-0") + '[polarizer]\ndriver = "by_hand"\n', r"polarizer. is left out"),
        (mosaic_rig("90-45-135-0", more='pixel_format = "RGB8"\n'), "camera.pixel_format: found 'RGB8'"),
        (
            mosaic_rig("90-45-135-0", more='pixel_format = "Mono12p"\nsaturation_counts = 65535\n'),
            r"saturation_counts \(65535\) is at most 4095 in Mono12p",
        ),
        (mosaic_rig("none"), "both or neither"),
    ],
)
def test_rigs_that_cannot_be_are_refused(text: str, words: str) -> None:
    with pytest.raises(FileMistake, match=words):
        parse_model(text, Rig, "rig.toml")


def test_a_format_brings_its_full_scale() -> None:
    rig = parse_model(mosaic_rig("90-45-135-0", more='pixel_format = "PolarizeMono12p"\n'), Rig, "rig.toml")
    assert rig.camera is not None
    assert rig.has_mosaic
    assert rig.camera.saturation_counts == 4095
    assert rig.camera.counts_dtype == "uint16"
