"""Calibration series of a simulated radar whose distortion is drawn anew for each trial."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.records import AudioBlock, Channel
from polfuse_lab.plans import SeriesTarget, parse_plan
from polfuse_lab.products.calibration_inputs import FocusedImage, TargetSpec
from polfuse_lab.products.calibration_series import average_views, find_target
from polfuse_lab.products.calibration_targets import TargetView, expected_scattering, reference_errors
from polfuse_lab.records import Sweeps
from polfuse_lab.rig import Geometry, Waveform
from polfuse_lab.session import SessionConfig, SessionWriter
from processing.calibration.distortion import CHANNELS, Distortion
from processing.calibration.polarimetric import PolarimetricCalibration, calibrate_targets
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.scene.model import FrontEnd, Reflector, Scene
from processing.scene.radar_response import reflector_scattering

Complexes = NDArray[np.complex128]

CENTRE_HZ, BANDWIDTH_HZ, GROUND_Z_M = 2.4e9, 80e6, -1.069
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / CENTRE_HZ
AMPLITUDE = 0.3
"""Beat of 1 m^2 at 1 m, fraction of full scale."""
POSITIONS, STEP_M, REPEATS = 37, 0.0508, 4
"""The thesis's short aperture (6 ft in steps of 2 in), and its mean of four repeats."""
RANGE_M, EDGE_M, CHECK_EDGE_M = 6.0, 0.61, 0.5
SNR_DB = 30.0
"""HH of the trihedral over noise, in one range profile of one position."""
CROSSTALK_DB, IMBALANCE_DB, IMBALANCE_DEG = -20.0, 2.0, 40.0


@dataclass(frozen=True)
class Errors:
    """Standard deviations of what is stated of the targets; each trial draws what is true."""

    angle_deg: float = 0.0
    fold_deg: float = 0.0
    position_m: float = 0.0
    edge_m: float = 0.0


@dataclass(frozen=True)
class Trial:
    """One radar calibrated."""

    truth: Distortion
    made: PolarimetricCalibration
    check_error_db: float
    """RCS of a second trihedral, measured with the calibration, minus the true one."""
    snr_db: float
    """Of the trihedral in the image."""

    @property
    def left(self) -> Distortion:
        """What the calibration leaves of the distortion."""
        return self.truth.residual(self.made.distortion)


def draw_distortion(random: np.random.Generator) -> Distortion:
    """Crosstalk of -20 dB and random phase in all four paths, 2 dB and 40 degrees on receive and on transmit."""
    gain = 10 ** (IMBALANCE_DB / 20) * np.exp(1j * np.radians(IMBALANCE_DEG))
    leak = 10 ** (CROSSTALK_DB / 20) * np.exp(2j * np.pi * random.random(4))
    receive = np.diag([1, gain]) @ np.array([[1, leak[0]], [leak[1], 1]])
    return Distortion(receive, np.array([[1, leak[2]], [leak[3], 1]]) @ np.diag([1, gain]))


def stated_targets(errors: Errors) -> list[TargetSpec]:
    """Trihedral, upright dihedral, dihedral at 45 degrees, and a smaller trihedral to be measured."""
    corner = TargetSpec(
        "trihedral", 0.0, RANGE_M, EDGE_M, np.radians(42), np.radians(33), angle_sd_rad=np.radians(errors.angle_deg),
        position_sd_m=errors.position_m, edge_sd_m=errors.edge_m, name="trihedral",
    )  # fmt: skip
    folds = [
        TargetSpec(
            "dihedral", 0.0, RANGE_M, EDGE_M, fold_rad=np.radians(fold), name=name,
            angle_sd_rad=np.radians(errors.fold_deg),
        )
        for name, fold in (("dihedral", 90.0), ("dihedral_45", 45.0))
    ]  # fmt: skip
    check = TargetSpec("trihedral", 0.0, RANGE_M, CHECK_EDGE_M, np.radians(50), np.radians(36), name="check")
    return [corner, *folds, check]


def run_trial(seed: int, errors: Errors, *, snr_db: float = SNR_DB, repeats: int = REPEATS, draws: int = 300) -> Trial:
    """Range profiles by their closed form, targets found in the images of each repeat, calibrated.

    Args:
        seed: of radar, noise and what the targets truly are.
        errors: of what is stated of the targets.
        snr_db: of one range profile.
        repeats: of each target.
        draws: of the budget's Monte Carlo.
    """
    random = np.random.default_rng(seed)
    truth = draw_distortion(random)
    antenna = np.zeros((POSITIONS, 3))
    antenna[:, 0] = (np.arange(POSITIONS) - (POSITIONS - 1) / 2) * STEP_M
    focused = _image(antenna)
    specs = stated_targets(errors)
    level = _hh_level(specs[0], antenna)
    views: list[TargetView] = []
    for spec in specs:
        true = _true(spec, errors, random)
        expected = expected_scattering(focused, spec)
        peaks = []
        for _ in range(repeats):
            profiles = _profiles(true, truth, antenna, level * 10 ** (-snr_db / 20), random)
            peaks.append(find_target(focused, profiles, spec, expected, 1.0, 10.0))
        views.append(average_views(spec, expected, peaks))
    made = calibrate_targets(
        [view.measured() for view in views[:3]],
        errors=reference_errors(focused, specs[0], views[0]),
        draws=draws,
        seed=seed,
    )
    check = views[3]
    measured = 10 ** (made.constant_db / 20) * made.distortion.remove(check.values)[0]
    error = 20 * np.log10(abs(measured) / abs(check.expected[0, 0]))
    return Trial(truth, made, float(error), views[0].snr_db)


def write_rig_series(path: Path, truth: Distortion, seed: int, *, positions: int, repeats: int) -> Path:
    """The same series as the simulated sound card samples it: a session of audio."""
    from hw_mocks.sound_card import AudioSettings, Synthesizer
    from hw_mocks.world import World

    waveform = Waveform(centre_hz=CENTRE_HZ, bandwidth_hz=BANDWIDTH_HZ, ramp_up_s=0.020, sweep_period_s=0.040)
    geometry = Geometry(antenna_height_m=-GROUND_Z_M)
    plan_text = rig_plan(positions, repeats)
    plan = parse_plan(plan_text, "plan.toml")
    stated = {target.name: target for target in plan.targets if isinstance(target, SeriesTarget)}
    level = _hh_level(TargetSpec.of(stated["trihedral"]), np.zeros((1, 3)))
    # Two sweeps of 960 samples: a Hann window's noise in a profile is 4 x 1.5 / 1920 of a sample's.
    noise = level * 10 ** (-SNR_DB / 20) / np.sqrt(6 / 1920)
    config = SessionConfig("collect", waveform, 48_000.0, sample_dtype="int16", rig_toml=RIG, plan_toml=plan_text)
    with SessionWriter.create(path, config, ballast_bytes=0) as writer:
        for visit in plan.visits():
            front = FrontEnd(truth.receive, truth.transmit, AMPLITUDE, noise=float(noise))
            reflector = TargetSpec.of(stated[visit.target]).reflector(GROUND_Z_M)
            scene = Scene("one", reflectors=(reflector,), front_end=front)
            for channel in Channel:
                world = World()
                world.trolley_x_m.hold(visit.x_m, 1)
                world.transmit.set(channel.transmit, 1)
                world.receive.set(channel.receive, 1)
                # The card's noise repeats with seed and place: each visit has a seed of its own.
                card = Synthesizer(scene, waveform, geometry, AudioSettings(), world, seed + 1000 * visit.position)
                block = AudioBlock(card.block(0, 6000, 10**12), 48_000.0, 0, 0.0, visit.position * 1_000_000)
                writer.write(Sweeps(block, channel, visit.position, x_m=visit.x_m, sweeps_requested=2))
    return path


RIG = f"""
name = "bench"
[waveform]
centre_hz = {CENTRE_HZ}
bandwidth_hz = {BANDWIDTH_HZ}
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = {-GROUND_Z_M}
[radar]
driver = "sounddevice"
[switches]
driver = "dowkey_ms"
[trolley]
driver = "by_hand"
length_m = 3.2
"""


def rig_plan(positions: int, repeats: int) -> str:
    """Plan file of the rig's series: the three targets and the one to be measured."""
    aperture_m = (positions - 1) * STEP_M
    head = f'kind = "calibration_series"\naperture_m = {aperture_m}\nstep_m = {STEP_M}\nrepeats = {repeats}\n'
    place = f"range_m = {RANGE_M}\n"
    return head + "".join(
        f'[[targets]]\nname = "{name}"\nkind = "{kind}"\n{place}edge_m = {edge}\n{more}'
        for name, kind, edge, more in (
            ("trihedral", "trihedral_square", EDGE_M, "azimuth_deg = 42\nelevation_deg = 33\n"),
            ("dihedral", "dihedral", EDGE_M, ""),
            ("dihedral_45", "dihedral_45", EDGE_M, ""),
            ("check", "trihedral_square", CHECK_EDGE_M, "azimuth_deg = 50\nelevation_deg = 36\n"),
        )
    )


def blank_image(antenna_m: NDArray[np.float64]) -> FocusedImage:
    """What the series are to calibrate, without a picture: settings alone."""
    return _image(antenna_m)


def _image(antenna_m: NDArray[np.float64]) -> FocusedImage:
    axis = np.array([0.0, 1.0])
    return FocusedImage(
        np.zeros((4, 2, 2), dtype=np.complex64), axis, axis + RANGE_M, GROUND_Z_M, CHANNELS, CENTRE_HZ, BANDWIDTH_HZ,
        antenna_m, {}, {"max_range_m": 30.0, "oversampling": 4},
    )  # fmt: skip


def _hh_level(spec: TargetSpec, antenna_m: NDArray[np.float64]) -> float:
    """Amplitude of the trihedral's HH in a profile, not compensated for range."""
    reflector = spec.reflector(GROUND_Z_M)
    away = float(np.linalg.norm(reflector.position_m))
    seen = reflector_scattering(reflector, antenna_m, WAVELENGTH_M)
    return float(AMPLITUDE * np.abs(seen[..., 0, 0]).mean() / away**2)


def _true(spec: TargetSpec, errors: Errors, random: np.random.Generator) -> Reflector:
    """What truly stands there. A target set up off its place keeps its direction, so that it is seen from another."""
    stated = spec.reflector(GROUND_Z_M)
    if spec.name == "check":
        return stated
    if spec.kind == "dihedral":
        return replace(stated, fold_rad=stated.fold_rad + np.radians(errors.fold_deg) * random.normal())
    azimuth, elevation = np.radians(errors.angle_deg) * random.normal(size=2)
    across, along = errors.position_m * random.normal(size=2)
    away = float(np.linalg.norm(stated.position_m))
    return replace(
        stated,
        azimuth_rad=stated.azimuth_rad + azimuth + across / away,
        elevation_rad=stated.elevation_rad + elevation + along * GROUND_Z_M / away**2,
        edge_m=stated.edge_m + errors.edge_m * random.normal(),
    )


def _profiles(
    reflector: Reflector,
    truth: Distortion,
    antenna_m: NDArray[np.float64],
    noise: float,
    random: np.random.Generator,
) -> RangeProfiles:
    """Range-compensated profiles: a Hann window's transform (Harris 1978), and white noise of amplitude ``noise``."""
    resolution = SPEED_OF_LIGHT_M_S / (2 * BANDWIDTH_HZ)
    axis = np.arange(0, 26, resolution / 8)
    away = np.linalg.norm(np.asarray(reflector.position_m) - antenna_m, axis=1)
    m = truth.apply(reflector_scattering(reflector, antenna_m, WAVELENGTH_M))
    cells = (axis[None, :] - away[:, None]) / resolution
    envelope = np.sinc(cells) + 0.5 * (np.sinc(cells - 1) + np.sinc(cells + 1))
    carrier = AMPLITUDE * np.exp(-4j * np.pi * away / WAVELENGTH_M) / away**2
    elements = np.stack([m[:, "HV".index(name[1]), "HV".index(name[0])] for name in CHANNELS])
    values = (elements * carrier)[:, :, None] * envelope
    # White noise of the beat, through the window: neighbouring bins are as much alike as the envelope says.
    half = 4 * 8
    shape = (4, len(antenna_m), len(axis) + 2 * half)
    white = random.normal(size=shape) + 1j * random.normal(size=shape)
    lag = np.arange(-half, half + 1) / 8
    kernel = np.sinc(lag) + 0.5 * (np.sinc(lag - 1) + np.sinc(lag + 1))
    kernel /= np.linalg.norm(kernel) * np.sqrt(2)
    spread = np.fft.ifft(np.fft.fft(white, axis=2) * np.fft.fft(kernel, shape[2]), axis=2)[:, :, 2 * half :]
    values = values + noise * spread
    power = np.full(values.shape[:2], noise**2)
    return RangeProfiles(
        values * axis**2, axis, antenna_m, CHANNELS, CENTRE_HZ, BANDWIDTH_HZ, "hann", True, noise=power
    )
