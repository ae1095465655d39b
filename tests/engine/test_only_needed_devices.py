"""A collect opens what its plan speaks to, and nothing else: the rest of the rig need not be connected."""

from __future__ import annotations

from polfuse_lab.replay import replay
from polfuse_lab.session import open_session

SERIES = 'kind = "polarizer_series"\nframes_per_angle = 2\ndark_frames = 0\nsettle_s = 0.0\n'


def test_camera_alone_without_a_radar(bench) -> None:
    absent = {"fault": "open"}
    bench.write(optics=True, radar=absent, switches=absent, trolley=absent)
    bench.plan.write_text(SERIES)
    outcome = bench.run()
    assert outcome.state == "finished", outcome.reason
    assert outcome.frames == 8
    with open_session(outcome.session) as session:
        assert [identity["kind"] for identity in session.config["identities"]] == ["camera", "polarizer"]
        assert session.config["sample_rate_hz"] == 48_000.0
        assert len(session.frames) == 8
    assert {text.split()[0] for _, text in bench.events()} == {"camera", "polarizer"}


def test_radar_alone_without_its_camera(bench) -> None:
    absent = {"fault": "open"}
    bench.write(optics=True, camera=absent, polarizer=absent)
    bench.plan.write_text(bench.plan.read_text().split("[optics]")[0])
    outcome = bench.run()
    assert outcome.state == "finished", outcome.reason


def test_camera_alone_is_replayed(bench) -> None:
    bench.write(optics=True)
    bench.plan.write_text(SERIES)
    outcome = bench.run()
    played = replay(outcome.session, bench.folder / "copy.h5")
    assert played.identical, played.differences
