"""Plans of every kind for property tests."""

from __future__ import annotations

from hypothesis import strategies as st

from polfuse_lab.plans import (
    ActiveOpticalPlan,
    CalibrationSeriesPlan,
    ContinuousSarPlan,
    DopplerPlan,
    OpticsPlan,
    Plan,
    PolarizerSeriesPlan,
    RailSarPlan,
    RangingPlan,
    SeriesTarget,
    SkyPlan,
)

CHANNELS = st.lists(st.sampled_from(["HH", "HV", "VH", "VV"]), min_size=1, max_size=4, unique=True).map(tuple)
ORDERS = st.sampled_from(["forward", "reverse", "serpentine"])
ANGLES = st.lists(st.floats(-180, 180), min_size=3, max_size=5, unique=True).map(tuple)
FEW = st.integers(1, 3)

looped = {"name": st.text(max_size=20).filter(str.isprintable), "repeats": FEW, "pause_every": st.integers(0, 4)}
channels = looped | {
    "channels": CHANNELS,
    "channel_order": st.sampled_from(["same", "alternate"]),
    "sweeps_per_channel": st.integers(1, 9),
}
optics = st.builds(
    OpticsPlan,
    angles_deg=ANGLES,
    frames_per_angle=FEW,
    settle_s=st.floats(0, 1),
    auto_exposure=st.booleans(),
    dark_frames=st.integers(0, 2),
)
targets = st.builds(
    SeriesTarget,
    name=st.sampled_from(["corner", "door", 'the "big" one']),
    kind=st.sampled_from(["trihedral", "trihedral_square", "dihedral", "dihedral_45", "plate"]),
    edge_m=st.floats(0.1, 2),
    range_m=st.floats(1, 20),
    x_m=st.floats(-1, 1),
)

rail = st.builds(
    RailSarPlan,
    aperture_m=st.floats(0.2, 1.5),
    step_m=st.floats(0.1, 0.2),
    track_order=ORDERS,
    passes=FEW,
    optics=st.none() | optics,
    **channels,
)
continuous = st.builds(
    ContinuousSarPlan,
    aperture_m=st.floats(0.2, 2.5),
    run_up_m=st.floats(0, 0.3),
    speed_m_s=st.floats(0.02, 1),
    channels=CHANNELS,
    track_order=ORDERS,
    passes=FEW,
    block_s=st.floats(0.1, 5),
    optics=st.none() | optics,
    **looped,
)
fixed = looped | {"channel": st.sampled_from(["HH", "VV"]), "x_m": st.none() | st.floats(-1.5, 1.5)}
others = st.one_of(
    st.builds(RangingPlan, seconds=st.floats(0.1, 5), **fixed),
    st.builds(RangingPlan, sweeps=st.integers(1, 99), **fixed),
    st.builds(DopplerPlan, seconds=st.floats(0.1, 5), ask_cw=st.booleans(), **fixed),
    st.builds(SkyPlan, optics=st.none() | optics, **channels),
    st.builds(
        CalibrationSeriesPlan,
        targets=st.lists(targets, min_size=1, max_size=3, unique_by=lambda target: target.name).map(tuple),
        aperture_m=st.just(0.0) | st.floats(0.2, 0.6),
        step_m=st.floats(0.05, 0.2),
        place_again=st.booleans(),
        **channels,
    ),
    st.builds(PolarizerSeriesPlan, angles_deg=ANGLES, frames_per_angle=FEW, dark_frames=st.integers(0, 2), **looped),
    st.builds(
        ActiveOpticalPlan,
        frames_per_pair=FEW,
        dark_frames=st.integers(0, 2),
        ambient_frames=st.integers(0, 2),
        auto_exposure=st.booleans(),
        **looped,
    ),
)
plans: st.SearchStrategy[Plan] = st.one_of(rail, continuous, others)
