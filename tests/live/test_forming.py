"""The SAR image as it forms: the same as back-projecting the same profiles at once, and a point in its place."""

from __future__ import annotations

import math

import numpy as np
import pytest
from live_rig import beat, rig, sweeps_record

from drivers.records import Channel, TrolleyFix
from polfuse_lab.live import Board, LiveView
from polfuse_lab.live.forming import PIXELS, Formed, Former, colour_scale, display_grid, pauli_rgb
from polfuse_lab.live.overlay import Overlay
from polfuse_lab.live.pictures import Polarized
from polfuse_lab.plans import parse_plan
from polfuse_lab.records import SweepFlag
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stokes import stokes_image
from processing.radar.profiles import RangeProfiles
from processing.sar.backprojection import backproject

HEIGHT = 1.069
TARGET = np.array([1.0, 9.0, -HEIGHT])
PLAN = 'aperture_m = 2.0\nstep_m = 0.05\nsweeps_per_channel = 2\nchannels = ["HH", "HV", "VV"]\n'


def record(x_m, channel=Channel.HH, position=0, amplitude=0.3, flags=SweepFlag.NONE):
    distance = float(np.linalg.norm(TARGET - [x_m, 0.0, 0.0]))
    return sweeps_record(beat(distance, amplitude, sweeps=4), channel, position, x_m, flags, requested=2)


def brightest(grid, plane):
    """Place of the brightest pixel, m. Range-compensated images rise with R^2, which moves wide peaks outwards."""
    x, y = np.meshgrid(grid.x_m, grid.y_m)
    level = np.nan_to_num(np.abs(plane)) / (x**2 + y**2 + grid.z_m**2)
    row, column = np.unravel_index(np.argmax(level), level.shape)
    return grid.x_m[column], grid.y_m[row]


@pytest.fixture
def former(tmp_path):
    board, view = Board(tmp_path), LiveView(tmp_path)
    yield Former(rig(), parse_plan(PLAN, "plan.toml"), board), view
    view.close()
    board.close()


def collect(former, channel=Channel.HH, amplitude=0.3):
    for position, x_m in enumerate(np.linspace(-1.0, 1.0, 41)):
        former.take(record(float(x_m), channel, position, amplitude))


def test_a_point_appears_where_it_stands_and_sharpens(former):
    forming, view = former
    collect(forming)
    forming.show(now=True)
    item = view.newest("sar")
    assert item.values["channels"] == ["HH"]
    assert item.values["positions"] == item.values["planned"] == 41
    x_m, y_m = brightest(forming._grid, item.arrays["image"][0])
    # A pixel is 0.04 m along and 0.47 m across.
    assert x_m == pytest.approx(TARGET[0], abs=0.06)
    assert y_m == pytest.approx(TARGET[1], abs=0.25)
    level = item.arrays["level_db"][0]
    np.testing.assert_array_equal(np.isfinite(level), np.isfinite(item.arrays["image"][0]))
    assert item.values["high_db"] - item.values["low_db"] == pytest.approx(40.0)


def test_position_by_position_is_as_all_at_once(former):
    forming, _ = former
    collect(forming)
    forming.show(now=True)
    grid, axis = forming._grid, forming._axis
    places = np.linspace(-1.0, 1.0, 41)
    values = np.array([forming._compressed(record(float(x)), apart=False)[0][0] for x in places])
    whole = backproject(
        RangeProfiles(
            values=values[None].astype(np.complex64),
            range_m=axis,
            antenna_m=np.column_stack([places, np.zeros((41, 2))]),
            channels=("HH",),
            centre_hz=2.4e9,
            bandwidth_hz=80e6,
            range_compensated=True,
        ),
        grid,
        interpolator="cubic",
        beamwidth_rad=math.radians(70.0),
        depression_rad=math.radians(17.0),
    )
    defined = np.isfinite(forming.formed.image)
    assert defined.any()
    difference = np.abs(forming.formed.image - whole)[defined]
    # Both are sums in float32 of 41 pulses; ranges and phases are float64.
    assert difference.max() < 2e-5 * np.nanmax(np.abs(whole))


def test_what_does_not_count_or_comes_again_adds_nothing(former):
    forming, view = former
    forming.take(record(-0.5, position=0))
    forming.take(record(0.5, position=1))
    forming.show(now=True)
    before = forming.formed.image.copy()
    forming.take(record(0.5, position=1))  # repeated since the collect was paused
    forming.take(record(0.0, position=2, flags=SweepFlag.LOST))
    forming.take(record(0.0, position=2, flags=SweepFlag.MOVED))
    forming.show(now=True)
    np.testing.assert_array_equal(forming.formed.image, before)
    assert view.newest("sar").values["positions"] == 2


def test_a_pass_forms_the_same_point(tmp_path):
    plan = parse_plan('kind = "continuous_sar"\naperture_m = 2.0\nspeed_m_s = 0.5\nchannels = ["HH"]\n', "plan.toml")
    board = Board(tmp_path)
    forming = Former(rig(), plan, board)
    second = 25 * 1920
    for block in range(4):
        # Each sweep at its own place: x = -1 + 0.5 t, t at the middle of its ramp (a quarter of the period).
        pieces = []
        for sweep in range(25):
            t = block + (sweep + 0.25) * 0.04
            distance = float(np.linalg.norm(TARGET - [-1.0 + 0.5 * t, 0.0, 0.0]))
            pieces.append(beat(distance, 0.3, sweeps=1))
        for part in range(5):
            t_ns = round((block + part / 4) * 1e9)
            forming.moved(TrolleyFix(-1.0 + 0.5 * (block + part / 4), 0.001, True, t_ns))
        samples = np.concatenate(pieces)
        assert len(samples) == second
        middle = -1.0 + 0.5 * (block + 0.5)
        forming.take(
            sweeps_record(samples, Channel.HH, block, middle, SweepFlag.CONTINUOUS, t_ns=block * 1_000_000_000)
        )
    forming.show(now=True)
    x_m, y_m = brightest(forming.formed.grid, forming.formed.image[0])
    assert x_m == pytest.approx(TARGET[0], abs=0.06)
    assert y_m == pytest.approx(TARGET[1], abs=0.25)
    board.close()


def test_pauli_colours_tell_odd_from_even_bounces(former):
    forming, view = former
    collect(forming, Channel.HH)
    collect(forming, Channel.VV)
    collect(forming, Channel.HV, amplitude=0.001)
    forming.show(now=True)
    item = view.newest("pauli")
    level = np.nan_to_num(np.abs(forming.formed.image[0]))
    row, column = np.unravel_index(np.argmax(level), level.shape)
    red, green, blue = item.arrays["rgb"][row, column]
    # HH = VV is a single bounce: blue (thesis 5.5).
    assert blue == 255
    assert red < 128
    assert green < 128
    formed = forming.formed
    planes = formed.image.copy()
    planes[2] *= -1  # VV = -HH: an even bounce
    even = pauli_rgb(Formed(formed.grid, formed.channels, planes, formed.low_db, formed.high_db, 0))
    assert even[row, column, 0] == 255
    assert even[row, column, 2] < 128
    assert pauli_rgb(Formed(formed.grid, ("HH",), planes[:1], 0.0, 1.0, 0)) is None


def test_a_grid_has_as_many_pixels_as_a_screen_shows():
    coarse = display_grid(rig(), np.linspace(-0.2, 0.2, 5))
    fine = display_grid(rig(**{"bandwidth_hz = 80e6": "bandwidth_hz = 800e6"}), np.linspace(-1.6, 1.6, 65))
    for grid in (coarse, fine):
        assert grid.shape[0] * grid.shape[1] < 1.03 * PIXELS
        assert grid.z_m == -HEIGHT
    assert fine.shape[0] * fine.shape[1] > 0.9 * PIXELS


def test_a_plan_without_an_aperture_forms_nothing(tmp_path):
    board = Board(tmp_path)
    forming = Former(rig(), parse_plan('kind = "polarizer_series"\n', "plan.toml"), board)
    assert not forming.useful
    forming.take(record(0.0))
    assert forming.formed is None
    board.close()


def test_a_scale_of_nothing_is_a_scale():
    assert colour_scale(np.full((3, 3), np.nan, np.float32)) == (0.0, 1.0)


def test_the_overlay_puts_the_camera_under_the_radar(tmp_path):
    # A camera that looks ahead over the ground, with light that rises to the right of its picture.
    rigged = rig()
    board, view = Board(tmp_path), LiveView(tmp_path)
    grid = display_grid(rigged, np.linspace(-1, 1, 21))
    image = np.full((1, *grid.shape), 1e-3 + 0j, np.complex64)
    row, column = np.argmin(np.abs(grid.y_m - 9.0)), np.argmin(np.abs(grid.x_m))
    image[0, row, column] = 10.0
    formed = Formed(grid, ("HH",), image, -20.0, 20.0, 5)
    series = PolarizerSeries(tuple(np.radians([0.0, 60.0, 120.0])), (4,) * 3, (0.0,) * 3, noise=SensorNoise(1.0, 1.0))
    ramp = np.broadcast_to(np.linspace(100, 900, 16, dtype=np.float32), (3, 12, 16)).copy()
    polarized = Polarized(stokes_image(ramp, np.zeros((12, 16), bool), series), 1, 7)
    overlay = Overlay(rigged, board)
    overlay.show(formed, polarized)
    item = view.newest("fusion")
    assert item.t_sample_ns == 7
    # f = 8 mm, 8 um pixels, 16 columns: the picture is 0.016 rad wide, 0.14 m at 9 m. Only what it sees has light.
    seen = np.isfinite(item.arrays["s0"])
    assert 0 < seen.sum() < seen.size / 100
    assert np.abs(grid.x_m[np.flatnonzero(seen.any(axis=0))]).max() < 0.016 / 2 * 21 + 0.05
    # The bright pixel is on the camera's axis only if the camera sees it; its colour is the radar's (amber).
    np.testing.assert_allclose(item.arrays["rgb"][row, column], [255, 176, 0], atol=1)
    assert item.values["registration_error_px"] > 10  # 1 degree is 17 pixels of 1 mrad
    number = item.number
    overlay.show(formed, polarized)
    assert view.newest("fusion", after=number) is None
    view.close()
    board.close()
