"""``polfuse optics``: from a session of the simulated camera to the stage, its picture and its JSON."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from optics_session import PITCH_M, RIG, SCENE, SIZE, series, write_session
from typer.testing import CliRunner

from hw_mocks.scene_file import load_scene
from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.optics import UNITS, optics, pinhole_of, series_of
from polfuse_lab.products.store import Products
from polfuse_lab.records import Exposure
from processing.errors import DataError
from processing.optics.camera_model import Pinhole
from processing.optics.regions import region_polarization
from processing.optics.stokes import Flag
from processing.scene.optical import stokes_image

STANDARD = (0.0, 45.0, 90.0, 135.0)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def exposures(scene: Path) -> list[Exposure]:
    return series(scene, STANDARD, 4, seed=1)


@pytest.fixture(scope="module")
def session(exposures: list[Exposure], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_session(tmp_path_factory.mktemp("session") / "session.h5", exposures)


def eroded(mask: np.ndarray) -> np.ndarray:
    """Pixels whose eight neighbours belong to the region too."""
    inner = mask.copy()
    for row in (-1, 0, 1):
        for column in (-1, 0, 1):
            inner &= np.roll(mask, (row, column), (0, 1))
    return inner


@pytest.mark.parametrize("seed", range(5))
def test_every_surface_has_its_polarization_within_two_sigma(scene: Path, tmp_path: Path, seed: int) -> None:
    path = write_session(tmp_path / "session.h5", series(scene, STANDARD, 4, seed))
    made = optics(path, tmp_path / "products.h5")
    products = Products(made.products)
    arrays, settings = products.read("optics"), products.settings("optics")
    world = load_scene(scene)
    _, index = stokes_image(world, pinhole_of(settings))
    for number, (dolp, degrees) in enumerate(((0.45, 30.0), (0.06, -70.0))):
        # Truth: as written in the scene.
        mask = eroded(index == number)
        region = region_polarization(arrays["s0"], arrays["s1"], arrays["s2"], mask, series_of(settings))
        assert abs(region.dolp - dolp) < 2 * region.dolp_sd
        assert region.dolp_sd < 0.003
        assert abs(region.aop - math.radians(degrees)) < 2 * region.aop_sd
        # Pixel by pixel the errors are as large as they say: sd of a spread from n pixels is known to 1/sqrt(2n).
        pulls = (arrays["dolp"][mask] - dolp) / arrays["dolp_sd"][mask]
        if dolp > 0.2:
            assert np.std(pulls) == pytest.approx(1.0, abs=4 / math.sqrt(2 * mask.sum()) + 0.03)


def test_the_stage_holds_all_that_later_stages_need(session: Path, tmp_path: Path) -> None:
    made = optics(session, tmp_path / "products.h5", figure=tmp_path / "optics.png")
    products = Products(made.products)
    arrays, settings = products.read("optics"), products.settings("optics")
    assert set(arrays) == set(UNITS)
    for name, array in arrays.items():
        assert array.shape == (SIZE[1], SIZE[0])
        assert array.dtype == (np.uint8 if name == "flags" else np.float32)
    np.testing.assert_array_equal(arrays["dolp"], made.image.dolp)
    assert pinhole_of(settings) == Pinhole(0.008, PITCH_M, *SIZE, (0.0, 0.0, 0.0), math.radians(9.0))
    assert series_of(settings) == made.series
    assert made.series.frames == (4, 4, 4, 4)
    assert made.series.angle_sd_rad == (math.radians(0.1),) * 4
    assert settings["flags"] == {flag.name: flag.value for flag in Flag}
    assert products.units("optics")["aop"] == "rad"
    assert [item["path"] for item in products.provenance("optics")["inputs"]] != []
    assert made.figure is not None
    assert made.figure.read_bytes().startswith(b"\x89PNG")


def test_one_seed_gives_the_same_arrays_to_the_last_bit(scene: Path, tmp_path: Path) -> None:
    planes = []
    for run, order in enumerate((STANDARD, STANDARD[::-1])):
        path = write_session(tmp_path / f"session{run}.h5", series(scene, order, 2, seed=5))
        optics(path, tmp_path / f"products{run}.h5")
        planes.append(Products(tmp_path / f"products{run}.h5").read("optics"))
    for name in UNITS:
        assert planes[0][name].tobytes() == planes[1][name].tobytes(), name


def test_command_prints_its_json(session: Path, tmp_path: Path) -> None:
    products = tmp_path / "products.h5"
    run = CliRunner().invoke(build(), ["optics", str(session), "-o", str(products), "--json"])
    assert run.exit_code == 0, run.output
    values = json.loads(run.stdout)
    arrays = Products(products).read("optics")
    assert values["dolp_median"] == pytest.approx(float(np.nanmedian(arrays["dolp"])), rel=1e-6)
    assert values["masked_fraction"] == pytest.approx(float(np.mean(np.isnan(arrays["dolp"]))))
    assert Path(values["figure"]).is_file()
    assert values["angles_deg"] == pytest.approx(list(STANDARD))
    assert values["frames"] == 16


def test_command_answers_mistakes_in_one_line(tmp_path: Path) -> None:
    run = CliRunner().invoke(build(), ["optics", str(tmp_path / "no.h5"), "-o", str(tmp_path / "p.h5"), "--json"])
    assert run.exit_code == 1
    assert run.stdout == ""
    assert len(run.stderr.strip().splitlines()) == 1
    assert "no.h5: does not exist" in run.stderr
    help_page = CliRunner().invoke(build(), ["optics", "--help"])
    assert "Example: polfuse optics" in help_page.stdout


def test_incomplete_frames_are_left_out_and_counted(exposures: list[Exposure], tmp_path: Path) -> None:
    torn = replace(exposures[3], frame=replace(exposures[3].frame, incomplete=True))
    made = optics(write_session(tmp_path / "s.h5", [*exposures[:3], torn, *exposures[4:]]), tmp_path / "p.h5")
    assert made.incomplete_frames == 1
    assert made.series.frames == (3, 4, 4, 4)
    assert not (made.image.flags & Flag.INCOMPLETE).any()


def test_dark_frames_are_subtracted(exposures: list[Exposure], tmp_path: Path) -> None:
    black = np.full_like(exposures[0].frame.image, 200)
    dark = Exposure(replace(exposures[0].frame, image=black), 0.0, dark=True)
    rig = RIG.replace("black_level_counts = 200.0", "black_level_counts = 0.0")
    made = optics(write_session(tmp_path / "s.h5", [*exposures, dark], rig=rig), tmp_path / "p.h5")
    known = optics(write_session(tmp_path / "t.h5", exposures), tmp_path / "q.h5")
    # A dark frame of exactly the black level: the same light.
    np.testing.assert_array_equal(made.image.s1, known.image.s1)
    assert made.series.dark_frames == 1


@pytest.mark.parametrize(
    ("spoil", "error", "words"),
    [
        (lambda items: items[:8], DataError, "condition number"),
        (lambda items: [], PolfuseError, "holds no camera frames"),
        (
            lambda items: [replace(items[0], frame=replace(items[0].frame, exposure_s=0.1)), *items[1:]],
            PolfuseError,
            "different exposure_s",
        ),
        (
            lambda items: [replace(i, frame=replace(i.frame, image=i.frame.image[:, 1:])) for i in items],
            PolfuseError,
            "97 x 73 pixels, its rig file says 98 x 73",
        ),
    ],
)
def test_sessions_that_cannot_be_used_are_refused(
    exposures: list[Exposure], tmp_path: Path, spoil: object, error: type, words: str
) -> None:
    path = write_session(tmp_path / "s.h5", spoil(exposures))  # type: ignore[operator]
    with pytest.raises(error, match=words):
        optics(path, tmp_path / "p.h5")
    assert not (tmp_path / "p.h5").exists()


def test_a_session_without_a_camera_is_refused(exposures: list[Exposure], tmp_path: Path) -> None:
    with pytest.raises(PolfuseError, match="without a camera"):
        optics(write_session(tmp_path / "s.h5", exposures, rig=None), tmp_path / "p.h5")
