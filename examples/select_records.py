"""Play a session once more, then take from it what one needs, as plain arrays.

python examples/select_records.py session.h5 arrays.npz
"""

import sys
from pathlib import Path

import numpy as np

import polfuse_lab as pf


def main(path: str, arrays: str) -> None:
    """Replay, select by channel, position and angle, and save the arrays for any other program."""
    played = pf.replay_session(path, Path(arrays).with_suffix(".replayed.h5"))
    print(f"the same scheduler once more: {'identical' if played.identical else played.differences}")

    with pf.open_session(played.session) as session:
        print(f"{len(session.steps)} steps were planned, the first of them {session.steps[0]}")
        records = session.select(channel="HH", position=slice(0, 3), latest=True)  # nothing has been read yet
        beats = np.stack([record[:4096] for record in records])  # (records, samples, inputs), as sampled
        x_m = np.array([record.x_m for record in records])
        angles = np.unique(np.degrees(session.frames["angle_rad"]).round(1))
        light = {angle: session.select_frames(angle_deg=angle, dark=False) for angle in angles}
        images = np.stack([np.mean([frame.image for frame in frames], axis=0) for frames in light.values()])
        rate_hz = session.sample_rate_hz

    np.savez(arrays, beats=beats, x_m=x_m, sample_rate_hz=rate_hz, angles_deg=angles, images=images)
    print(f"{arrays}: beats {beats.shape} of {beats.dtype}, images {images.shape} at {angles} degrees")


if __name__ == "__main__":
    main(*sys.argv[1:])
