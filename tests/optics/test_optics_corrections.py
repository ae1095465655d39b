"""``polfuse optics`` with calibrations, registration, demosaicers and the active mode, from made-up frames."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from optics_session import RIG, write_session
from typer.testing import CliRunner

from benchmarks.optics_scenes import binned, fine_scene
from drivers.records import Frame
from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.optics import optics
from polfuse_lab.products.optics_active import active_optics, image_of
from polfuse_lab.products.optics_calibration import calibrate_analysers, calibrate_flat, calibrate_linearity
from polfuse_lab.products.store import Products
from polfuse_lab.records import Exposure, FrameFlag
from polfuse_lab.report.pictures import stage_pictures
from processing.errors import DataError
from processing.optics.analyser import measurement_matrix
from processing.optics.flat import Linearity
from processing.optics.mosaic import parse_mosaic, through_mosaic
from processing.optics.stokes import Flag

SIZE = (80, 64)
"""Columns and rows."""
BLACK = 200.0
ANGLES = (0.0, 45.0, 90.0, 135.0)
BENT = Linearity((2e-6, -1e-11), 6e4)
ROWS, COLUMNS = SIZE[1], SIZE[0]
Y, X = np.mgrid[-1 : 1 : ROWS * 1j, -1 : 1 : COLUMNS * 1j]
VIGNETTE = 1 / (1 + 0.4 * (X**2 + Y**2))
STATE = np.array([2e4, 5e3, -3e3])


def rig(mosaic: str = "none", *, source: bool = False) -> str:
    text = RIG.replace("width_px = 98", f"width_px = {COLUMNS}").replace("height_px = 73", f"height_px = {ROWS}")
    if mosaic != "none":
        text = text.split("[polarizer]")[0] + f'mosaic = "{mosaic}"\nmosaic_extinction_ratio = 300.0\n'
    if source:
        text += '[source_polarizer]\ndriver = "by_hand"\nextinction_ratio = 800.0\n'
    return text


def frame(light: np.ndarray, seed: int, exposure_s: float = 0.001, number: int = 0) -> Frame:
    random = np.random.default_rng(seed)
    counts = random.poisson(np.maximum(light, 0)) + random.normal(BLACK, 12.0, light.shape)
    return Frame(np.clip(np.rint(counts), 0, 65_535).astype(np.uint16), number, exposure_s, 0.0, 0.0, number)


def bent(light: np.ndarray) -> np.ndarray:
    """Counts of a sensor whose light is BENT.light(counts)."""
    x = light.astype(float).copy()
    for _ in range(30):
        x -= (BENT.light(x) - light) / BENT.slope(x)
    return x


def series(stokes: np.ndarray, degrees: tuple[float, ...] = ANGLES, frames: int = 2) -> list[Exposure]:
    """Frames of a bent, vignetted sensor behind a turning 800:1 polarizer; ``stokes`` (3, rows, columns)."""
    taken = []
    for row, angle in zip(measurement_matrix(np.radians(degrees), 800.0), degrees, strict=True):
        light = bent(np.tensordot(row, stokes, 1) * VIGNETTE)
        taken += [Exposure(frame(light, 10 * round(angle) + n), math.radians(angle)) for n in range(frames)]
    return taken


def uniform(state: np.ndarray = STATE) -> np.ndarray:
    return np.broadcast_to(state[:, None, None], (3, ROWS, COLUMNS))


def run(*arguments: object) -> dict[str, object]:
    ran = CliRunner().invoke(build(), ["optics", *map(str, arguments), "--json"])
    assert ran.exit_code == 0, ran.output
    values: dict[str, object] = json.loads(ran.stdout)
    return values


def test_linearity_and_flat_field_are_made_and_applied(tmp_path: Path) -> None:
    exposures = np.linspace(0.2, 2.7, 9) * 1e-3
    steps = [Exposure(frame(bent(2e7 * t * np.ones((ROWS, COLUMNS))), n, t), 0.0) for n, t in enumerate(exposures)]
    bright = [Exposure(frame(bent(4e4 * VIGNETTE), 100 + n), 0.0) for n in range(12)]
    camera = tmp_path / "camera.h5"
    linear = run(write_session(tmp_path / "steps.h5", steps, rig=rig()), "-o", camera, "--as", "linearity")
    # What the made-up sensor bends at its top, by its own coefficients; light of 5,000 pixels is known to 1e-4.
    top = linear["until_counts"]
    assert linear["correction_at_top"] == pytest.approx(float(BENT.light(top) / top - 1), abs=1e-3)
    flat = run(write_session(tmp_path / "bright.h5", bright, rig=rig()), "-o", camera, "--as", "flat")
    assert flat["bad_pixels"] == 0
    response = Products(camera).read("flat")["response"]
    np.testing.assert_allclose(response, VIGNETTE / VIGNETTE.mean(), rtol=0.01)

    session = write_session(tmp_path / "s.h5", series(uniform()), rig=rig())
    raw = run(session, "-o", tmp_path / "raw.h5")
    made = run(session, "-o", tmp_path / "good.h5", "--correct", camera)
    truth = math.hypot(STATE[1], STATE[2]) / STATE[0]
    assert abs(float(made["dolp_median"]) - truth) < 2e-4
    # Bent by 2 % at half of full scale, the raw one is off by more than its noise.
    assert abs(float(raw["dolp_median"]) - truth) > 1e-3
    arrays, settings = Products(tmp_path / "good.h5").read("optics"), Products(tmp_path / "good.h5").settings("optics")
    assert settings["corrected"] == ["linearity", "flat"]
    s0 = arrays["s0"]
    # The flat field's mean is 1, so light is in counts of the mean pixel.
    np.testing.assert_allclose(np.median(s0), STATE[0] * VIGNETTE.mean(), rtol=2e-3)
    pulls = (arrays["dolp"] - truth) / arrays["dolp_sd"]
    assert np.std(pulls) == pytest.approx(1, abs=0.1)
    # Flat field and linearity are known from 12 frames: their noise is shared by all four angles and cancels.
    assert np.std((s0 - np.median(s0)) / arrays["s0_sd"]) < 1.4


@pytest.fixture(scope="module")
def displaced(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray, np.ndarray]:
    """A session whose images are displaced by eighths of a pixel; its true DOLP and the shifts, pixels."""
    over = 8
    fine = fine_scene(COLUMNS, 3, over, strongest=0.4)[:, : ROWS * over]
    truth = binned(fine, over)
    moved = []
    steps = ((0, 0), (5, -3), (-4, 6), (2, 7))
    for row, angle, step in zip(measurement_matrix(np.radians(ANGLES), 800.0), ANGLES, steps, strict=True):
        light = binned(np.roll(np.tensordot(row, fine, 1), step, (0, 1)), over)
        moved += [Exposure(frame(light, 7 + n), math.radians(angle)) for n in range(2)]
    session = write_session(tmp_path_factory.mktemp("displaced") / "s.h5", moved, rig=rig())
    return session, np.hypot(truth[1], truth[2]) / truth[0], np.array(steps) / over


def test_shifted_images_are_put_in_place(displaced, tmp_path: Path) -> None:
    session, dolp, steps = displaced
    plain = optics(session, tmp_path / "plain.h5")
    made = run(session, "-o", tmp_path / "p.h5", "--register", "auto")
    shifts = np.array(made["shifts_px"])
    np.testing.assert_allclose(shifts, steps, atol=0.06)
    arrays = Products(tmp_path / "p.h5").read("optics")
    inner = np.s_[6:-6, 6:-6]
    after = np.nanstd((arrays["dolp_raw"] - dolp)[inner])
    before = np.nanstd((plain.image.dolp_raw - dolp)[inner])
    assert after < before / 2.5
    settings = Products(tmp_path / "p.h5").settings("optics")
    assert [item["undone"] for item in settings["shifts_px"]] == [False, True, True, True]
    assert settings["registration"] == "auto"
    # What one of the images does not reach is undefined, and says so.
    assert (arrays["flags"][0] & Flag.INCOMPLETE).all()


def test_a_tolerance_has_images_put_in_place_and_the_product_says_why(displaced, tmp_path: Path) -> None:
    session, dolp, steps = displaced
    undone, errors = [], []
    for tolerance in (-6.0, -30.0):
        products = tmp_path / f"{-tolerance}.h5"
        made = optics(session, products, tolerance_db=tolerance)
        np.testing.assert_allclose([(shift.down, shift.right) for shift in made.shifts], steps, atol=0.06)
        settings = Products(products).settings("optics")
        undone.append([item["undone"] for item in settings["shifts_px"]])
        assert (settings["tolerance_db"], settings["tolerance_kept"]) == (tolerance, True)
        assert settings["predicted_error_db"] == settings["considered"][settings["registration"]] < tolerance
        assert made.choice is not None
        assert settings["reason"] in made.choice.explain()[0]
        errors.append(float(np.nanstd((made.image.dolp_raw - dolp)[6:-6, 6:-6])))
    assert undone == [[False] * 4, [False, True, True, True]]
    assert errors[1] < errors[0] / 2
    words = ["optics", str(session), "-o", str(tmp_path / "p.h5")]
    ran = CliRunner().invoke(build(), [*words, "--tolerance", "field", "--explain"])
    assert ran.exit_code == 0, ran.output
    assert all(line in ran.stdout for line in made.choice.explain())
    assert "not left where they are: -" in ran.stdout
    for wrong in (["--tolerance=-30", "--register", "off"], ["--tolerance", "perfect"], ["--tolerance=3"]):
        ran = CliRunner().invoke(build(), [*words, *wrong])
        assert ran.exit_code != 0
        assert "Traceback" not in ran.output
    with pytest.raises(PolfuseError, match="a tolerance chooses how images are put in place; leave --register out"):
        optics(session, tmp_path / "p.h5", register="auto", tolerance_db=-30.0)
    with pytest.raises(PolfuseError, match="there is no mosaic to interpolate; leave --demosaic out"):
        optics(session, tmp_path / "p.h5", demosaic="newton")


def test_shifts_of_a_mosaic_are_not_asked_for_in_vain(tmp_path: Path) -> None:
    image = through_mosaic(np.array(uniform()), parse_mosaic("90-45-135-0"), 300.0)
    session = write_session(tmp_path / "s.h5", [Exposure(frame(image, 1), 0.0)], rig=rig("90-45-135-0"))
    for register in ("on", "auto"):
        with pytest.raises(PolfuseError, match="there are no images to put in place; leave --register out"):
            optics(session, tmp_path / "p.h5", register=register)
    assert not (tmp_path / "p.h5").exists()
    assert not optics(session, tmp_path / "p.h5", register="off").shifts


@pytest.mark.parametrize("demosaic", ["bilinear", "newton", "residual"])
def test_demosaicers_are_reached_and_their_errors_hold(tmp_path: Path, demosaic: str) -> None:
    image = through_mosaic(np.array(uniform()), parse_mosaic("90-45-135-0"), 300.0)
    session = write_session(tmp_path / "s.h5", [Exposure(frame(image, 1), 0.0)], rig=rig("90-45-135-0"))
    made = run(session, "-o", tmp_path / "p.h5", "--demosaic", demosaic)
    truth = math.hypot(STATE[1], STATE[2]) / STATE[0]
    assert abs(float(made["dolp_median"]) - truth) < 1e-3
    arrays = Products(tmp_path / "p.h5").read("optics")
    pulls = (arrays["dolp"] - truth) / arrays["dolp_sd"]
    # Pixels share samples, so their number counts a quarter; residuals choose their weights by the noise itself.
    assert np.std(pulls[8:-8, 8:-8]) == pytest.approx(1, abs=0.15)


def active_frames(
    mueller: np.ndarray, source: tuple[float, ...], sensor: tuple[float, ...], *, mosaic: str = "none"
) -> list[Exposure]:
    """Frames of a surface by an 800:1 source polarizer, with 500 counts of ambient light, and frames of that alone."""
    ambient = np.array([500.0, 100.0, 0.0])
    taken = []
    for n, lit in enumerate((None, *source)):
        state = ambient
        if lit is not None:
            state = ambient + mueller @ (4e4 * measurement_matrix([math.radians(lit)], 800.0)[0])
        plane = np.array(np.broadcast_to(state[:, None, None], (3, ROWS, COLUMNS)))
        angle = None if lit is None else math.radians(lit)
        if mosaic != "none":
            light = through_mosaic(plane, parse_mosaic(mosaic), 300.0)
            taken += [Exposure(frame(light, 50 * n + k), 0.0, source_angle_rad=angle) for k in range(2)]
            continue
        for m, degrees in enumerate(sensor):
            light = np.tensordot(measurement_matrix([math.radians(degrees)], 800.0)[0], plane, 1)
            taken += [
                Exposure(frame(light, 1000 * n + 10 * m + k), math.radians(degrees), source_angle_rad=angle)
                for k in range(2)
            ]
    return taken


DIATTENUATING = np.array([[0.6, 0.1, 0.0], [0.1, 0.5, 0.0], [0.0, 0.0, 0.4]])


@pytest.mark.parametrize("mosaic", ["none", "90-45-135-0"])
def test_the_active_mode_gives_its_four_channels(tmp_path: Path, mosaic: str) -> None:
    taken = active_frames(DIATTENUATING, (0.0, 90.0), (0.0, 90.0), mosaic=mosaic)
    session = write_session(tmp_path / "s.h5", taken, rig=rig(mosaic, source=True))
    made = run(session, "-o", tmp_path / "p.h5")
    arrays = Products(tmp_path / "p.h5").read("active_optics")
    # Behind ideal polarizers, w_r^T M w_s with w = (1, +-1, 0) / 2 and a lamp of 4e4 counts.
    h, v = np.array([0.5, 0.5, 0.0]), np.array([0.5, -0.5, 0.0])
    expected = [4e4 * r @ DIATTENUATING @ s for s in (h, v) for r in (h, v)]
    for plane, sd, true in zip(arrays["intensities"], arrays["sds"], expected, strict=True):
        assert abs(float(np.mean(plane)) - true) < 6 * float(np.mean(sd)) / math.sqrt(plane.size / 4)
    hh, hv, vh, vv = expected
    assert float(made["dolp_median"]) == pytest.approx((hh + vh - hv - vv) / sum(expected), abs=2e-3)
    assert made["source_angles_deg"] == pytest.approx([0.0, 90.0])
    assert made["frames"] == (4 if mosaic != "none" else 8)
    assert made["ambient_frames"] == (2 if mosaic != "none" else 4)
    assert Path(str(made["figure"])).read_bytes().startswith(b"\x89PNG")
    np.testing.assert_allclose(arrays["pauli"][2], arrays["intensities"][0] + arrays["intensities"][3], rtol=1e-5)
    np.testing.assert_array_equal(image_of(Products(tmp_path / "p.h5")).dolp, arrays["dolp"])
    assert [picture.name for picture in stage_pictures(Products(tmp_path / "p.h5"))] == ["active_optics"]
    for name, value in (("--tolerance", "field"), ("--register", "auto"), ("--demosaic", "newton")):
        ran = CliRunner().invoke(build(), ["optics", str(session), "-o", str(tmp_path / "q.h5"), name, value])
        assert ran.exit_code == 2
        assert "nothing to choose" in ran.output
        assert name in ran.output


@pytest.mark.parametrize("mosaic", ["none", "90-45-135-0"])
def test_analysers_are_calibrated_with_a_turning_source_and_applied(tmp_path: Path, mosaic: str) -> None:
    # The mount's (or the mosaic's) true angles are 1.5 degrees further than it says, and 135 passes 4 % less.
    true_rows = measurement_matrix(np.radians(ANGLES) + math.radians(1.5), 150.0)
    true_rows[3] *= 0.96

    def image(state: np.ndarray, k: int) -> np.ndarray:
        light = true_rows @ state
        if mosaic == "none":
            return np.full((ROWS, COLUMNS), light[k])
        made = np.empty((ROWS, COLUMNS))
        for value, angle in zip(light, ANGLES, strict=True):
            i, j = parse_mosaic(mosaic).place(round(angle))
            made[i::2, j::2] = value
        return made

    settings = range(1) if mosaic != "none" else range(4)
    taken = []
    for lit in range(0, 180, 20):
        state = 4e4 * measurement_matrix([math.radians(lit)], 800.0)[0]
        for k in settings:
            angle = math.radians(ANGLES[k]) if mosaic == "none" else 0.0
            taken.append(Exposure(frame(image(state, k), 10 * lit + k), angle, source_angle_rad=math.radians(lit)))
    camera = tmp_path / "camera.h5"
    made = run(write_session(tmp_path / "c.h5", taken, rig=rig(mosaic, source=True)), "-o", camera, "--as", "analyser")
    np.testing.assert_allclose(made["offsets_deg"], 1.5, atol=0.03)
    np.testing.assert_allclose(made["extinction_ratio"], 150.0, rtol=0.1)
    transmittance = np.array(made["transmittance"])
    assert transmittance[3] / transmittance[:3].mean() == pytest.approx(0.96, abs=1e-3)

    shots = [
        Exposure(frame(image(STATE, k), 900 + k), math.radians(ANGLES[k]) if mosaic == "none" else 0.0)
        for k in settings
    ]
    session = write_session(tmp_path / "s.h5", shots, rig=rig(mosaic))
    found = run(session, "-o", tmp_path / "p.h5", "--correct", camera)
    assert abs(float(found["dolp_median"]) - math.hypot(STATE[1], STATE[2]) / STATE[0]) < 8e-4
    aop = np.median(Products(tmp_path / "p.h5").read("optics")["aop"])
    assert math.degrees(aop) == pytest.approx(math.degrees(0.5 * math.atan2(STATE[2], STATE[1])), abs=0.1)


def test_frames_that_a_polarizer_turned_in_are_left_out(tmp_path: Path) -> None:
    taken = active_frames(DIATTENUATING, (0.0, 90.0), (0.0, 90.0))
    spoilt = Exposure(frame(np.full((ROWS, COLUMNS), 6e4), 1), 0.3, source_angle_rad=0.1, flags=FrameFlag.MOVED)
    made = active_optics(write_session(tmp_path / "s.h5", [spoilt, *taken], rig=rig(source=True)), tmp_path / "p.h5")
    assert made.frames == 8


def test_sessions_that_do_not_fit_are_answered(tmp_path: Path) -> None:
    plain = write_session(tmp_path / "plain.h5", series(uniform(), frames=1), rig=rig())
    for function in (active_optics, calibrate_analysers):
        with pytest.raises(PolfuseError, match="no frames with a polarizer before the light source"):
            function(plain, tmp_path / "p.h5")
    taken = active_frames(DIATTENUATING, (0.0, 90.0), (0.0, 90.0))
    active = write_session(tmp_path / "active.h5", taken, rig=rig(source=True))
    with pytest.raises(PolfuseError, match="before the light source"):
        optics(active, tmp_path / "p.h5")
    torn = write_session(tmp_path / "torn.h5", taken[:-2], rig=rig(source=True))
    with pytest.raises(PolfuseError, match="same angles for each angle"):
        active_optics(torn, tmp_path / "p.h5")
    turned = [Exposure(item.frame, item.angle_rad + 0.2) for item in series(uniform(), frames=1)]
    source = active_frames(DIATTENUATING, (0.0, 60.0, 120.0), ANGLES)
    calibrate_analysers(write_session(tmp_path / "c.h5", source, rig=rig(source=True)), tmp_path / "camera.h5")
    with pytest.raises(DataError, match="analysers were calibrated at 0, 45, 90, 135 degrees"):
        optics(
            write_session(tmp_path / "t.h5", turned, rig=rig()),
            tmp_path / "p.h5",
            corrections=tmp_path / "camera.h5",
        )
    calibrate_flat(plain, tmp_path / "camera.h5")
    other = write_session(
        tmp_path / "other.h5",
        [Exposure(frame(np.full((ROWS, COLUMNS), 5.0), n, 1e-3 * (1 + n)), 0.0) for n in range(3)],
        rig=rig(),
    )
    ran = CliRunner().invoke(build(), ["optics", str(other), "-o", str(tmp_path / "l.h5"), "--as", "linearity"])
    assert ran.exit_code == 1
    assert "different exposures" in ran.stderr
    taken = series(uniform(), frames=1)
    object.__setattr__(taken[0].frame, "gain_db", 6.0)
    louder = write_session(tmp_path / "gain.h5", taken, rig=rig())
    with pytest.raises(PolfuseError, match="different gain_db"):
        calibrate_linearity(louder, tmp_path / "l.h5")


def test_frames_that_are_saturated_everywhere_are_masked_everywhere(tmp_path: Path) -> None:
    full = [Exposure(frame(np.full((ROWS, COLUMNS), 1e6), 1), math.radians(angle)) for angle in ANGLES]
    made = run(write_session(tmp_path / "s.h5", full, rig=rig()), "-o", tmp_path / "p.h5", "--register", "auto")
    assert made["masked_fraction"] == 1.0
    assert made["dolp_median"] is None
    assert Path(str(made["composite"])).read_bytes().startswith(b"\x89PNG")
