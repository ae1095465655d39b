"""Small plans of every kind, which between them hold every kind of step."""

from __future__ import annotations

from drivers.records import Channel
from polfuse_lab.plans import PLAN_KINDS, custom_plan, plan_to_toml
from polfuse_lab.plans.steps import (
    Ask,
    AutoExpose,
    Checkpoint,
    Expose,
    Mark,
    MoveTo,
    RecordPass,
    RecordSeconds,
    RecordSweeps,
    SelectChannel,
    Settle,
    StartTurn,
    TurnPolarizer,
    TurnSource,
)

LIMITS = "retries = 2\nreconnect_wait_s = 8.0\nmax_reconnects = 4\n"
OPTICS = "angles_deg = [0.0, 45.0, 90.0]\nframes_per_angle = 1\nsettle_s = 0.0\n"
TARGET = '[[targets]]\nname = "{}"\nkind = "{}"\nedge_m = 0.3\nrange_m = 4.0\n'

EVERYTHING = (
    Mark("the first half"),
    MoveTo(-0.1, 0),
    Settle(0.02),
    StartTurn(0.8),
    SelectChannel(Channel.VH),
    RecordSweeps(2, 0, Channel.VH),
    TurnPolarizer(0.8),
    TurnSource(0.4),
    Expose(2, 0.8, source_angle_rad=0.4),
    Checkpoint(0),
    Ask("Go on?"),
    AutoExpose((0.0, 0.8)),
    Expose(1, 0.8, dark=True),
    MoveTo(0.15, 10_000),
    SelectChannel(Channel.HV),
    RecordPass(0.15, -0.15, 0.4, 10_000, Channel.HV, 0.15),
    Checkpoint(1),
    SelectChannel(Channel.VV),
    RecordSeconds(0.4, 2, Channel.VV),
    Checkpoint(2),
)

PLANS: dict[str, str] = {
    "rail_sar": LIMITS
    + 'aperture_m = 0.2\nstep_m = 0.1\nchannels = ["HH", "HV"]\nsweeps_per_channel = 2\nmove_settle_s = 0.01\n'
    + f"[optics]\n{OPTICS}",
    "rail_sar there and back": LIMITS
    + 'aperture_m = 0.1\nstep_m = 0.1\nchannels = ["VV", "VH", "HH"]\nchannel_order = "alternate"\n'
    + 'track_order = "serpentine"\npasses = 2\npause_every = 3\nsweeps_per_channel = 1\nmove_settle_s = 0.0\n',
    "continuous_sar": 'kind = "continuous_sar"\n'
    + LIMITS
    + 'aperture_m = 0.4\nspeed_m_s = 0.5\nblock_s = 0.15\nchannels = ["HH", "VV"]\nmove_settle_s = 0.01\n',
    "ranging": f'kind = "ranging"\n{LIMITS}channel = "HV"\nx_m = 0.1\nseconds = 0.5\nrepeats = 3\n',
    "ranging in sweeps": f'kind = "ranging"\n{LIMITS}channel = "VV"\nsweeps = 20\nrepeats = 3\n',
    "doppler": f'kind = "doppler"\n{LIMITS}channel = "VV"\nseconds = 0.5\nrepeats = 2\n',
    "sky": f'kind = "sky"\n{LIMITS}sweeps_per_channel = 3\nrepeats = 2\n',
    "calibration_series": f'kind = "calibration_series"\n{LIMITS}sweeps_per_channel = 1\nrepeats = 2\n'
    + 'channels = ["HH", "VV"]\nmove_settle_s = 0.0\n'
    + TARGET.format("one", "trihedral")
    + TARGET.format("two", "dihedral_45"),
    "polarizer_series": f'kind = "polarizer_series"\n{LIMITS}{OPTICS}dark_frames = 2\nauto_exposure = true\n',
    "active_optical": f'kind = "active_optical"\n{LIMITS}frames_per_pair = 1\nsettle_s = 0.0\ndark_frames = 1\n'
    + "ambient_frames = 1\n",
    "custom": plan_to_toml(
        custom_plan(EVERYTHING, name="everything", retries=2, reconnect_wait_s=8.0, max_reconnects=4)
    ),
}
"""Plans by name, as TOML; every kind of plan is there."""

assert {text.partition('kind = "')[2].partition('"')[0] or "rail_sar" for text in PLANS.values()} >= set(PLAN_KINDS)
