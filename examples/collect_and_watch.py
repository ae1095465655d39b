"""Carry out a plan on a rig and watch it; the session is whole even if this program is stopped.

polfuse sim examples/scenes/field.toml --rig-out rig.toml      (in another terminal)
python examples/collect_and_watch.py rig.toml session.h5
"""

import sys

import numpy as np

import polfuse_lab as pf
from polfuse_lab.engine import StatusEvent
from polfuse_lab.plans import OpticsPlan, RailSarPlan


def watch(status: StatusEvent) -> None:
    """Say where the collect is, and where the newest range profile is strongest beyond 3 m."""
    line = f"step {status.step} of {status.steps}: {status.reason}"
    if status.preview is not None:
        level_db = np.frombuffer(status.preview.level_db, "<f4")
        near = round(3.0 / status.preview.step_m)
        strongest = near + int(np.argmax(level_db[near:]))
        line += f"; {status.preview.channel} is strongest at {strongest * status.preview.step_m:.1f} m"
    print(line)


def main(rig: str, session: str) -> None:
    """Run a small collect there and back along the rail, then say what is in the session."""
    optics = OpticsPlan(frames_per_angle=1)
    plan = RailSarPlan(aperture_m=0.1016, channels=("HH", "VV"), passes=2, track_order="serpentine", optics=optics)
    outcome = pf.collect(rig, plan, session, on_status=watch)
    if outcome.state != "finished":
        sys.exit(f"{outcome.state}: {outcome.reason}")
    profiles = pf.range_profiles(session)  # both passes averaged
    print(f"{outcome.sweeps} audio records, {outcome.frames} frames, {len(profiles.antenna_m)} places along the rail")


if __name__ == "__main__":
    main(*sys.argv[1:])
