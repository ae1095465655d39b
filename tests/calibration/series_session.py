"""Sessions of a calibration series and of a scene, their beats by the closed form, with a known front end and noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rail_data import BANDWIDTH_HZ, CENTRE_HZ, HEIGHT_M, C
from rail_session import RATE_HZ, RIG, samples

from drivers.records import AudioBlock, Channel
from polfuse_lab.plans import parse_plan
from polfuse_lab.products.calibration_inputs import TargetSpec
from polfuse_lab.records import Sweeps
from polfuse_lab.rig import Waveform
from polfuse_lab.session import SessionConfig, SessionWriter
from processing.scene.radar_response import reflector_scattering

WAVEFORM = Waveform(centre_hz=CENTRE_HZ, bandwidth_hz=BANDWIDTH_HZ, ramp_up_s=0.02, sweep_period_s=0.04)
SECONDS = 0.13

PLAN = """
kind = "calibration_series"
aperture_m = 0.2
step_m = 0.1
repeats = 2
[[targets]]
name = "corner"
kind = "trihedral_square"
edge_m = 0.61
range_m = 6.0
azimuth_deg = 42
elevation_deg = 33
[[targets]]
name = "upright"
kind = "dihedral"
edge_m = 0.61
range_m = 6.0
angle_sd_deg = 0.3
[[targets]]
name = "turned"
kind = "dihedral_45"
edge_m = 0.61
range_m = 6.0
angle_sd_deg = 0.3
"""


def write_records(path: Path, scenes, positions, *, plan=None, noise=0.0, gain=1.0, seed=0, channels=tuple(Channel)):
    """A session of one record for each position and channel.

    ``scenes``: what stands there at each position, [(place, M), ...]; ``noise``: rms of a sample, of full scale, drawn
    anew for every sample; ``gain``: of the beat, which is clipped at full scale.
    """
    random = np.random.default_rng(seed)
    config = SessionConfig("collect", WAVEFORM, RATE_HZ, sample_dtype="float32", rig_toml=RIG, plan_toml=plan)
    with SessionWriter.create(path, config, ballast_bytes=0) as writer:
        for position, (x, scene) in enumerate(zip(positions, scenes, strict=True)):
            for channel in channels:
                recorded = samples(x, scene, channel, seconds=SECONDS)
                recorded[:, 0] = np.clip(gain * recorded[:, 0] + noise * random.normal(size=len(recorded)), -1, 1)
                block = AudioBlock(recorded.astype(np.float32), RATE_HZ, 0, 0.0, position * 1_000_000)
                writer.write(Sweeps(block, channel, position, x_m=float(x), sweeps_requested=2))
    return path


def write_series(path: Path, plan: str, truth, *, changed=None, **options):
    """A series whose targets are seen through a radar with distortion ``truth``.

    ``changed``: by name, a function of the reflector stated that makes the one that stands there instead, or None for
    nothing at all.
    """
    parsed = parse_plan(plan, "plan.toml")
    stated = {target.name: target for target in parsed.targets}
    scenes = []
    for visit in parsed.visits():
        reflector = TargetSpec.of(stated[visit.target]).reflector(-HEIGHT_M)
        if changed is not None and visit.target in changed:
            reflector = changed[visit.target](reflector)
        scenes.append([] if reflector is None else [seen(reflector, truth, visit.x_m)])
    return write_records(path, scenes, [visit.x_m for visit in parsed.visits()], plan=plan, **options)


def seen(reflector, truth, x_m):
    """(place, M) of a reflector from one position."""
    s = reflector_scattering(reflector, np.array([x_m, 0.0, 0.0]), C / CENTRE_HZ)
    return reflector.position_m, truth.apply(s)
