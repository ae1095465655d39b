"""Functions of the numerics that take arrays, each with one ordinary call: what the walk goes by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from processing.calibration import (
    canonical,
    distortion,
    distributed,
    imbalance,
    noise,
    offset,
    radar_equation,
    rcs,
)
from processing.fusion import anomalies, confusion, features, isodata, kmeans, registration, separability, supervised
from processing.optics import (
    active,
    analyser,
    binning,
    debias,
    demosaic,
    demosaic_newton,
    demosaic_residual,
    flat,
    fresnel,
    jones,
    mosaic_stokes,
    mueller,
    regions,
    shifts,
    stokes,
    stokes_vectors,
)
from processing.optics.camera_model import Pinhole
from processing.optics.mosaic import parse_mosaic
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.polarimetry import (
    averaging,
    coherent,
    entropy_bias,
    freeman,
    h_a_alpha,
    matrices,
    pauli,
    signatures,
    touzi,
    wishart,
    yamaguchi,
    zones,
)
from processing.polarimetry.detection import cfar, filters
from processing.polarimetry.speckle import nonlocal_means, quality, refined_lee
from processing.radar import antenna, beat, doppler, line_fit, ranging, ridges, sync, tracks, waveguide_antenna
from processing.raytrace import moller_trumbore
from processing.sar import quality as image_quality
from processing.sar import sharpness

Array = NDArray[Any]
_RNG = np.random.default_rng(20)
ROWS, COLUMNS = 10, 12


@dataclass(frozen=True)
class Case:
    """One function with arguments that it takes."""

    name: str
    call: Callable[..., Any]
    arrays: tuple[Array, ...]
    """Arguments that are arrays; the first of them is the one that is varied."""
    counts: bool = False
    """Whether the first holds whole numbers, or must have its type for another reason."""
    pixels: tuple[int, ...] | None = None
    """Axes of the first that count pixels or samples; the last two, or the only one, where left out."""

    @property
    def pixel_axes(self) -> tuple[int, ...]:
        """Axes of the first array that may have any length."""
        if self.pixels is not None:
            return self.pixels
        dimensions = self.arrays[0].ndim
        return tuple(range(dimensions))[-2:]

    def __str__(self) -> str:
        return self.name


def real(*shape: int, low: float = 0.5, high: float = 2.0) -> Array:
    """Numbers that float16 holds exactly."""
    return np.asarray(_RNG.uniform(low, high, shape).astype(np.float16), dtype=np.float64)


def compound(*shape: int) -> Array:
    """Complex numbers whose parts float16 holds exactly."""
    return real(*shape, low=-2.0, high=2.0) + 1j * real(*shape, low=-2.0, high=2.0)


def states(count: int) -> Array:
    """(count, 4) Stokes vectors of partly polarized light."""
    return real(count, 4) * [4, 1, 1, 1]


def coherency(*shape: int) -> Array:
    """(9, ...) planes of coherency matrices of four looks."""
    k = compound(4, 3, *shape)
    matrix = np.einsum("li...,lj...->...ij", k, k.conj()) / 4
    planes = matrices.planes_of_matrix(matrix)
    return np.asarray(planes.astype(np.float16), dtype=np.float64)


SERIES = PolarizerSeries(tuple(np.radians([0, 45, 90, 135])), (1,) * 4, (0.001,) * 4, 800.0, SensorNoise(2.0, 1.0))
SONY = parse_mosaic("90-45-135-0")
CAMERA = Pinhole(0.008, 8.3e-6, 64, 48, (0.0, 0.0, 0.5), 0.15)
POLARIZERS = np.array([[0.5, 0.5, 0.0], [0.5, 0.0, 0.5], [0.5, -0.5, 0.0], [0.5, 0.0, -0.5]])
CROSSED = np.array([0.0, 0.0, 1.5625, 1.5625])
RANGE_M = np.linspace(1.0, 30.0, 24)
PLANES = coherency(ROWS, COLUMNS)
MATRICES = matrices.matrix_of_planes(PLANES)
IMAGE = real(ROWS, COLUMNS)
CHANNELS = compound(4, ROWS, COLUMNS)
VEGETATION = CHANNELS[[0, 1, 1, 3]] * np.array([1, 0.5, 0.5, 1])[:, None, None]
ANGLES = real(7, low=-1.0, high=1.0)
DARK = np.zeros((ROWS, COLUMNS), dtype=bool)
LIGHT = np.round(real(4, ROWS, COLUMNS) * 100)
COUNTS = np.round(real(ROWS, COLUMNS) * 1000)


def _stereo() -> Array:
    """(n, 2) a beat and a sync of six sweeps."""
    n = np.arange(480)
    up = np.mod(n - 10, 80) < 40
    return np.stack([0.25 * np.cos(0.3 * n), np.where(up, 0.75, -0.75)], axis=1)


CASES = [
    # light
    Case("stokes_planes", lambda a: stokes.stokes_planes(a, DARK[: a.shape[1], : a.shape[2]], SERIES), (LIGHT,)),
    Case(
        "stokes_planes_reference",
        lambda a: stokes.stokes_planes_reference(a, DARK[: a.shape[1], : a.shape[2]], SERIES),
        (LIGHT,),
    ),
    Case("stokes_image", lambda a: stokes.stokes_image(a, DARK[: a.shape[1], : a.shape[2]], SERIES).dolp, (LIGHT,)),
    Case("debias", debias.debias, (real(9), real(9))),
    Case(
        "polarization",
        debias.polarization,
        (states(9)[:, :3], np.broadcast_to(0.01 * np.eye(3), (9, 3, 3))),
        pixels=(0,),
    ),
    Case("demosaic", lambda a: demosaic.demosaic(a, SONY), (COUNTS,)),
    Case("demosaic_reference", lambda a: demosaic.demosaic_reference(a, SONY), (COUNTS,)),
    Case("demosaic_newton", lambda a: demosaic_newton.demosaic_newton(a, SONY), (COUNTS,)),
    Case("demosaic_residual", lambda a: demosaic_residual.demosaic_residual(a, SONY), (COUNTS,)),
    Case("mosaic_stokes", lambda a: mosaic_stokes.mosaic_stokes(a, SONY), (COUNTS.astype(np.float32),), counts=True),
    Case(
        "mosaic_stokes_reference",
        lambda a: mosaic_stokes.mosaic_stokes_reference(a, SONY),
        (COUNTS.astype(np.float32),),
        counts=True,
    ),
    Case("bin_frame", lambda a: binning.bin_frame(a, 2, 4095), (COUNTS.astype(np.uint16),), counts=True),
    Case(
        "bin_frame_reference",
        lambda a: binning.bin_frame_reference(a, 2, 4095),
        (COUNTS.astype(np.uint16),),
        counts=True,
    ),
    Case("flat_field", flat.flat_field, (COUNTS,)),
    Case(
        "fit_linearity",
        lambda a, t: flat.fit_linearity(a, t).coefficients,
        (np.arange(1.0, 9) * 100, np.arange(1.0, 9)),
    ),
    Case("measure_shift", lambda a, b: shifts.measure_shift(a, b).down, (real(32, 32), real(32, 32))),
    Case("registered", lambda a: shifts.registered(a, np.zeros(a.shape, dtype=bool), "off")[0], (LIGHT,)),
    Case(
        "region_polarization",
        lambda a, b, c: regions.region_polarization(a, b, c, np.ones(a.shape, dtype=bool), SERIES).dolp,
        (IMAGE * 8 + 100, IMAGE, IMAGE),
    ),
    Case("fresnel amplitudes", fresnel.amplitudes, (real(7) + 1j * real(7), real(7, low=0.1, high=1.0))),
    Case("reflectances", fresnel.reflectances, (real(7) + 1j * real(7), real(7, low=0.1, high=1.0))),
    Case("mueller chain", mueller.chain, (real(4, 4), real(4, 4)), pixels=()),
    Case("nearest_realizable", mueller.nearest_realizable, (real(4, 4),), pixels=()),
    Case("is_realizable", mueller.is_realizable, (real(4, 4),), pixels=()),
    Case("depolarization_index", mueller.depolarization_index, (real(4, 4),), pixels=()),
    Case("diattenuation", mueller.diattenuation, (real(4, 4),), pixels=()),
    Case("jones to mueller", jones.mueller, (compound(2, 2),), pixels=()),
    Case("mueller to jones", jones.of_mueller, (np.diag([1.0, 1.0, -1.0, -1.0]),), pixels=()),
    Case("jones to stokes", jones.stokes, (compound(5, 2),), pixels=(0,)),
    Case("dolp", stokes_vectors.dolp, (states(5),), pixels=(0,)),
    Case("dop", stokes_vectors.dop, (states(5),), pixels=(0,)),
    Case("aop", stokes_vectors.aop, (states(5),), pixels=(0,)),
    Case("ellipticity", stokes_vectors.ellipticity, (states(5),), pixels=(0,)),
    Case("measurement_matrix", analyser.measurement_matrix, (np.array([0, 0.75, 1.5, 2.25]),)),
    Case("least_squares", analyser.least_squares, (POLARIZERS,), pixels=(0,)),
    Case("channel_weights", active.channel_weights, (CROSSED, CROSSED[[0, 2, 0, 2]])),
    # polarimetry
    Case("window_average", lambda a: averaging.window_average(a, 3), (PLANES,)),
    Case("window_average_reference", lambda a: averaging.window_average_reference(a, 3), (PLANES,)),
    Case("h_a_alpha", h_a_alpha.h_a_alpha, (PLANES,)),
    Case("h_a_alpha_reference", h_a_alpha.h_a_alpha_reference, (PLANES,)),
    Case("freeman_durden", freeman.freeman_durden, (PLANES,)),
    Case("freeman_durden_reference", freeman.freeman_durden_reference, (PLANES,)),
    Case("yamaguchi", yamaguchi.yamaguchi, (PLANES,)),
    Case("yamaguchi_reference", yamaguchi.yamaguchi_reference, (PLANES,)),
    Case("touzi", touzi.touzi, (PLANES,)),
    Case("touzi_reference", touzi.touzi_reference, (PLANES,)),
    Case("refined_lee", lambda a: refined_lee.refined_lee(a, 5, looks=4), (PLANES,)),
    Case("refined_lee_reference", lambda a: refined_lee.refined_lee_reference(a, 5, looks=4), (PLANES,)),
    Case("nonlocal_means", lambda a: nonlocal_means.nonlocal_means(a, looks=4, search=5), (PLANES,)),
    Case(
        "wishart_assign",
        wishart.wishart_assign,
        (PLANES, np.stack([PLANES.mean(axis=(1, 2)), PLANES[:, :5].mean(axis=(1, 2))], axis=1)),
    ),
    Case("krogager", coherent.krogager, (compound(6, 2, 2),), pixels=(0,)),
    Case("krogager_powers", coherent.krogager_powers, (PLANES,)),
    Case("cameron", coherent.cameron, (CHANNELS,)),
    Case("cameron_reference", coherent.cameron_reference, (CHANNELS,)),
    Case("pauli_vector", pauli.pauli_vector, tuple(CHANNELS[:3])),
    Case("span", pauli.span, (CHANNELS[:3],)),
    Case("display_components", pauli.display_components, (CHANNELS[:3],)),
    Case("equivalent_dolp", pauli.equivalent_dolp, (matrices.matrix_of_planes(PLANES),), pixels=(0, 1)),
    Case("received_power_dolp", pauli.received_power_dolp, (IMAGE, IMAGE / 4, IMAGE / 4, IMAGE / 2)),
    Case("covariance_of_coherency", matrices.covariance_of_coherency, (PLANES,)),
    Case("matrix_of_planes", matrices.matrix_of_planes, (PLANES,)),
    Case("coherency_turned", matrices.coherency_turned, (MATRICES, np.array(0.3)), pixels=(0, 1)),
    Case("entropy_of", entropy_bias.entropy_of, (real(3, 5),), pixels=(1,)),
    Case("h_alpha_zones", zones.h_alpha_zones, (real(6, low=0.1, high=0.9), real(6, low=0.1, high=1.5))),
    Case("signature", lambda a: signatures.signature(a, orientations=5, ellipticities=3).co, (np.eye(3),), pixels=()),
    Case(
        "kennaugh_of_coherency", signatures.kennaugh_of_coherency, (matrices.matrix_of_planes(PLANES),), pixels=(0, 1)
    ),
    Case("cfar", lambda a: cfar.cfar(a, false_alarm=0.01, looks=1, ring=cfar.Ring(5, 3)), (IMAGE,)),
    Case("cfar_reference", lambda a: cfar.cfar_reference(a, false_alarm=0.01, looks=1, ring=cfar.Ring(5, 3)), (IMAGE,)),
    Case("whitened", filters.whitened, (PLANES, PLANES.mean(axis=(1, 2)))),
    Case("equivalent_looks", quality.equivalent_looks, (IMAGE,)),
    Case("estimated_looks", lambda a: quality.estimated_looks(a, 3), (IMAGE,)),
    # calibration
    Case("to_dbsm", rcs.to_dbsm, (IMAGE,)),
    Case("from_dbsm", rcs.from_dbsm, (IMAGE,)),
    Case("plate_amplitude", lambda a, b: rcs.plate_amplitude(1.0, 1.0, a, b, 0.125), (ANGLES, ANGLES)),
    Case("dihedral_rcs", lambda a, b: rcs.dihedral_rcs(1.0, 1.0, 0.125, a, b), (ANGLES, ANGLES)),
    Case("square_trihedral_rcs", lambda a, b: rcs.square_trihedral_rcs(1.0, 0.125, a, b), (ANGLES, ANGLES)),
    Case("triangular_trihedral_rcs", lambda a, b: rcs.triangular_trihedral_rcs(1.0, 0.125, a, b), (ANGLES, ANGLES)),
    Case("cylinder_rcs", lambda a: canonical.cylinder_rcs(0.1, 1.0, 0.125, a), (ANGLES,)),
    Case("disc_amplitude", lambda a: canonical.disc_amplitude(0.5, a, 0.125), (ANGLES,)),
    Case(
        "received_power",
        lambda a, r: radar_equation.received_power(a, r, transmit_w=1.0, aperture_m2=0.01, wavelength_m=0.125),
        (real(5), real(5)),
    ),
    Case(
        "rcs_from_power",
        lambda a, r: radar_equation.rcs_from_power(a, r, transmit_w=1.0, aperture_m2=0.01, wavelength_m=0.125),
        (real(5), real(5)),
    ),
    Case("range_compensation", radar_equation.range_compensation, (real(5),)),
    Case("background_by_row", noise.background_by_row, (CHANNELS[0],)),
    Case(
        "noise_floor",
        lambda a: noise.noise_floor(a, RANGE_M, window_m=5.0, range_compensated=False),
        (compound(2, 3, 24),),
    ),
    Case("background_power", offset.background_power, (CHANNELS[0],)),
    Case("matrices", distortion.matrices, (compound(6, 4),), pixels=(0,)),
    Case("remove distortion", distortion.Distortion.isolated(1.1, 0.9j).remove, (compound(4, 6),), pixels=(1,)),
    Case("estimate_crosstalk", lambda a: distributed.estimate_crosstalk(a).cross_ratio, (VEGETATION,)),
    Case(
        "cross_ratio",
        lambda a, b: imbalance.cross_ratio(a, b, np.ones(a.shape, dtype=bool)),
        (CHANNELS[1], CHANNELS[1] * 1j),
    ),
    # fusion
    Case("normalized_components", features.normalized_components, (CHANNELS[:3],)),
    Case("fused_vector", features.fused_vector, (real(3, ROWS, COLUMNS), real(ROWS, COLUMNS, high=1.0))),
    Case("kmeans", lambda a: kmeans.kmeans(a, 2).centres, (real(40, 3),), pixels=(0,)),
    Case("isodata", lambda a: isodata.isodata(a).centres, (real(40, 3),), pixels=(0,)),
    Case("gaussian_mixture", lambda a: supervised.gaussian_mixture(a, 2).weights, (real(40, 3),), pixels=(0,)),
    Case("reed_xiaoli", anomalies.reed_xiaoli, (real(3, ROWS, COLUMNS),)),
    Case("local_reed_xiaoli", lambda a: anomalies.local_reed_xiaoli(a, guard=1, reach=3), (real(3, ROWS, COLUMNS),)),
    Case("constrained_energy", anomalies.constrained_energy, (real(3, ROWS, COLUMNS), real(3))),
    Case("class_statistics", lambda a: separability.class_statistics(a).covariance, (real(40, 3),), pixels=(0,)),
    Case(
        "confusion", lambda a, b: confusion.confusion(a, b, 3).counts, (np.arange(9) % 3, np.arange(9) % 2), counts=True
    ),
    Case("sample_bilinear", registration.sample_bilinear, (IMAGE, real(6) * 3, real(6) * 3)),
    Case(
        "ground_to_camera", lambda a, b: registration.ground_to_camera(CAMERA, a, b, -1.0), (ANGLES, 5 + np.arange(4.0))
    ),
    # radar
    Case("find_sync", lambda a: sync.find_sync(a, 2000.0).starts, (_stereo(),), pixels=(0,)),
    Case("average", ranging.average, (compound(5, 24),)),
    Case("remove_coupling", ranging.remove_coupling, (compound(5, 24),)),
    Case("noise_of_average", ranging.noise_of_average, (compound(5, 24),)),
    Case("two_pulse_canceller", doppler.two_pulse_canceller, (compound(8, 24),)),
    Case("remove_background", lambda a: doppler.remove_background(a, 3), (compound(8, 24),)),
    Case("range_doppler", lambda a: doppler.range_doppler(a, 0.04, 0.125), (compound(8, 24),)),
    Case("mean_range_doppler", lambda a: doppler.mean_range_doppler(a, 0.04, 0.125, sweeps=4), (compound(8, 24),)),
    Case("noise_normalised_db", tracks.noise_normalised_db, (compound(8, 24),)),
    Case("best_path", lambda a: ridges.best_path(a, np.array([0.0])).total, (real(6, 9),), pixels=(0,)),
    Case("robust_line", lambda a, b: line_fit.robust_line(a, b).slope, (np.arange(9.0), real(9))),
    Case("one_way_gain", lambda a: antenna.one_way_gain(a, 1.2), (real(6, low=-1.0, high=1.0),)),
    Case(
        "circular_waveguide_pattern",
        lambda a: waveguide_antenna.circular_waveguide_pattern(a, 0.3, 0.08, 0.125),
        (real(6, low=0.0, high=1.5),),
    ),
    Case(
        "beat_of_ranges",
        lambda a, k, r: beat.beat_of_ranges(a, k, r, [1.0]),
        (2048 + np.arange(8.0), np.full(8, 4e9), np.array([15.0])),
    ),
    Case("intersect", moller_trumbore.intersect, (real(5, 3), real(5, 3), real(5, 3, 3)), pixels=(0,)),
    # images
    Case("image_entropy", sharpness.image_entropy, (CHANNELS[0],)),
    Case("image_contrast", sharpness.image_contrast, (CHANNELS[0],)),
    Case("complex_correlation", image_quality.complex_correlation, (CHANNELS[0], CHANNELS[1])),
    Case("value_between", image_quality.value_between, (CHANNELS[0], np.array([4.5]), np.array([5.5]))),
]
"""Nearly every public function that takes an array of measured values."""
