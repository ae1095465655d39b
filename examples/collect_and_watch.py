"""Carry out a plan on a rig and watch it; the session is whole even if this program is stopped.

polfuse sim examples/scenes/field.toml --rig-out rig.toml      (in another terminal)
python examples/collect_and_watch.py rig.toml plan.toml session.h5
"""

import sys

import polfuse_lab as pf


def main(rig: str, plan: str, session: str) -> None:
    """Run a collect, then say what is in it."""
    outcome = pf.collect(rig, plan, session, on_status=lambda status: print(status.step, status.steps, status.reason))
    print(f"{outcome.state}: {outcome.reason}")
    with pf.open_session(session) as recorded:
        print(f"{len(recorded.sweeps)} audio records, {len(recorded.frames)} camera frames")
        profiles = pf.range_profiles(recorded)
        print(f"{profiles.values.shape[1]} positions, {profiles.range_m[-1]:.0f} m of range in {profiles.channels}")


if __name__ == "__main__":
    main(*sys.argv[1:])
