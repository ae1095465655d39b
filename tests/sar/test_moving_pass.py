"""Passes without stops: the trolley moves while it sweeps, and focusing knows how fast."""

from dataclasses import replace

import numpy as np
import pytest
from rail_data import BANDWIDTH_HZ, CELL_M, CENTRE_HZ, HEIGHT_M, C, ground
from rail_session import PERIOD, RAMP, RATE_HZ, RIG

from drivers.records import AudioBlock, Channel, TrolleyFix
from polfuse_lab.products.focus import focus
from polfuse_lab.products.ranging import range_profiles
from polfuse_lab.records import SweepFlag, Sweeps
from polfuse_lab.rig import Waveform
from polfuse_lab.scale.focus_tiles import Scale
from polfuse_lab.session import SessionConfig, SessionWriter, open_session
from processing.sar.backprojection import backproject
from processing.sar.continuous import sweep_motion

TARGET = (5.0, 7.0, -HEIGHT_M)
FROM_M, SECONDS, SPEED_M_S = -0.75, 4.0, 0.4


def beat(seconds, speed_m_s):
    """(n, 2) float32: the echo of a point and sync, from first principles: range at every sample's own instant."""
    n = np.arange(round(seconds * RATE_HZ), dtype=np.float64)
    since = np.mod(n - 300.25, PERIOD)
    up = since < RAMP
    slope = np.where(up, 1, -1) * BANDWIDTH_HZ / np.where(up, RAMP, PERIOD - RAMP) * RATE_HZ
    frequency = CENTRE_HZ + slope * (since - np.where(up, RAMP / 2, (PERIOD + RAMP) / 2)) / RATE_HZ
    x = FROM_M + speed_m_s * n / RATE_HZ
    tau = 2 * np.sqrt((TARGET[0] - x) ** 2 + TARGET[1] ** 2 + TARGET[2] ** 2) / C
    voltage = 0.3 * np.cos(2 * np.pi * tau * frequency - np.pi * slope * tau**2)
    edges = sum(np.clip((since - at) / 3 + 0.5, 0, 1) * sign for at, sign in ((0.0, 1), (RAMP, -1), (PERIOD, 1)))
    return np.stack([voltage, 0.8 * (2 * edges - 1)], axis=1).astype(np.float32)


def pass_session(path, speed_m_s, seconds=SECONDS):
    waveform = Waveform(centre_hz=CENTRE_HZ, bandwidth_hz=BANDWIDTH_HZ, ramp_up_s=0.02, sweep_period_s=0.04)
    config = SessionConfig("collect", waveform, RATE_HZ, sample_dtype="float32", rig_toml=RIG)
    samples = beat(seconds, speed_m_s)
    begun, block = 1_000_000_000, 9600
    with SessionWriter.create(path, config, ballast_bytes=0) as writer:
        for t in np.arange(-0.1, seconds + 0.1, 0.05):
            writer.write(TrolleyFix(FROM_M + speed_m_s * t, 1e-4, True, begun + round(t * 1e9), "run"))
        for number, first in enumerate(range(0, len(samples), block)):
            at = begun + round(first / RATE_HZ * 1e9)
            audio = AudioBlock(samples[first : first + block], RATE_HZ, first, first / RATE_HZ, at)
            writer.write(Sweeps(audio, Channel.HH, number, flags=SweepFlag.CONTINUOUS))
    return path


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    return pass_session(tmp_path_factory.mktemp("pass") / "pass.h5", SPEED_M_S)


def test_sweeps_hand_their_velocity_over(moving):
    with open_session(moving) as session:
        profiles = range_profiles(session, oversampling=8, max_range_m=30.0)
    np.testing.assert_allclose(
        profiles.velocity_m_s, np.tile([SPEED_M_S, 0, 0], (len(profiles.antenna_m), 1)), rtol=1e-6
    )
    assert profiles.ramp_s == pytest.approx(RAMP / RATE_HZ, rel=1e-3)
    decided = sweep_motion(profiles)
    # f_c / K = 0.6 s: 0.24 m of the cell's 1.87 at 0.4 m/s.
    assert decided.modelled
    assert decided.walk_m == pytest.approx(SPEED_M_S * CENTRE_HZ * RAMP / RATE_HZ / BANDWIDTH_HZ, rel=1e-3)


def test_range_walk_is_modelled_and_leaving_it_out_costs_what_was_told(moving):
    with open_session(moving) as session:
        profiles = range_profiles(session, oversampling=8, max_range_m=30.0)
    grid = ground(np.arange(4.0, 6.0, 0.1), np.arange(5.5, 8.5, 0.2))
    # What a trolley that stood at the same places would have recorded: Hann's envelope, shifted sincs, in closed form.
    away = np.linalg.norm(np.asarray(TARGET) - profiles.antenna_m, axis=1)[:, None]
    cells = (profiles.range_m - away) / CELL_M
    envelope = np.sinc(cells) + 0.5 * np.sinc(cells - 1) + 0.5 * np.sinc(cells + 1)
    values = envelope * np.exp(-4j * np.pi * CENTRE_HZ / C * away) * profiles.range_m**2
    truth = backproject(replace(profiles, values=values[None]), grid, motion="still")
    errors = {}
    for motion in ("moving", "still"):
        image = backproject(profiles, grid, motion=motion)
        image = image * (np.vdot(image, truth) / np.vdot(image, image))
        errors[motion] = np.linalg.norm(image - truth) / np.linalg.norm(truth)
    # Hann's spectrum lies nearer the band's middle than the flat one of the bound: less than it, but of its kind.
    bound = 10 ** (sweep_motion(profiles).still_error_db / 20)
    assert 0.1 * bound < errors["still"] < bound
    # What is left: the turning of the phase within the ramp, and the beat's mirror image far away.
    assert errors["moving"] < 0.2 * errors["still"]


def test_the_product_tells_what_was_done_and_tiles_have_its_bits(moving, tmp_path):
    grid = ground(np.arange(2.5, 7.5, 0.1), np.arange(4.0, 10.0, 0.15))
    whole = focus(moving, tmp_path / "whole.h5", grid=grid, compensate_pattern=False)
    assert whole.choice.method == "bp"
    assert "is modelled" in whole.settings["motion"]
    assert (whole.peaks[0].x_m, whole.peaks[0].y_m) == pytest.approx(TARGET[:2], abs=0.1)
    pieces = focus(moving, tmp_path / "pieces.h5", grid=grid, compensate_pattern=False, scale=Scale(tile=16))
    np.testing.assert_array_equal(pieces.image[...], whole.image)
    assert pieces.settings["motion"] == whole.settings["motion"]


def test_a_creeping_trolley_is_taken_to_stand(tmp_path):
    path = pass_session(tmp_path / "slow.h5", 1e-4, 1.0)
    with open_session(path) as session:
        decided = sweep_motion(range_profiles(session, max_range_m=30.0))
    assert not decided.modelled
    assert "left out" in decided.reason
