"""The simulated GRBL controller answers as the transcript of real GRBL 1.1h firmware does."""

from __future__ import annotations

import time

from grbl_helpers import BANNER

from hw_mocks.grbl import Grbl
from hw_mocks.world import World


def test_the_simulation_answers_as_the_transcript() -> None:
    grbl = Grbl(World(), length_m=4.0, origin_m=0.0, start_delay_s=0.0, hold_s=0.05)
    assert grbl.handle(b"\x18") == BANNER
    assert grbl.handle(b"$I\n") == b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"
    assert grbl.handle(b"$H\n") == b"error:5\r\n"
    assert grbl.handle(b"G91\nG1 X100 F500\n") == b"ok\r\nok\r\n"
    time.sleep(0.02)
    assert grbl.handle(b"?").startswith(b"<Run|MPos:0.")
    assert grbl.handle(b"$H\n") == b"error:8\r\n"
    assert grbl.handle(b"!?").startswith(b"<Hold:1|")
    assert grbl.handle(b"~?").startswith(b"<Hold:1|")  # a resume during Hold:1 is ignored
    time.sleep(0.06)
    assert grbl.handle(b"?").startswith(b"<Hold:0|")
    assert grbl.handle(b"~?").startswith(b"<Run|")
    assert grbl.handle(b"\x18") == b"ALARM:3\r\n" + BANNER + b"[MSG:'$H'|'$X' to unlock]\r\n"
    assert grbl.handle(b"G1 X1 F100\n") == b"error:9\r\n"
    assert grbl.handle(b"?").startswith(b"<Alarm|")
    assert grbl.handle(b"$X\n") == b"[MSG:Caution: Unlocked]\r\nok\r\n"
    assert grbl.handle(b"G5 X1\n") == b"error:20\r\n"
    assert grbl.handle(b"G1 Xa F1\n") == b"error:2\r\n"
    assert grbl.handle(b"12\n") == b"error:1\r\n"
    assert grbl.handle(b"G1 X1\n") == b"error:22\r\n"  # the reset forgot the feed
    assert grbl.handle(b"$Q\n\n") == b"error:3\r\nok\r\n"


def test_the_simulation_keeps_its_position_over_a_reset_in_a_finished_hold() -> None:
    world = World()
    grbl = Grbl(world, length_m=4.0, origin_m=0.0, start_delay_s=0.0, hold_s=0.01)
    grbl.handle(b"G1 X1000 F6000\n")
    time.sleep(0.03)
    grbl.handle(b"!")
    time.sleep(0.02)
    held = world.trolley_x_m.at()
    assert grbl.handle(b"?").startswith(b"<Hold:0|")
    assert grbl.handle(b"\x18") == BANNER
    assert grbl.handle(b"?").startswith(b"<Idle|")
    assert world.trolley_x_m.at() == held > 0


def test_offset_comes_only_in_some_simulated_reports() -> None:
    grbl = Grbl(World(), length_m=4.0)
    reports = [grbl.handle(b"?") for _ in range(25)]
    with_offset = [b"WCO:" in report for report in reports]
    assert with_offset[0]
    assert sum(with_offset) == 3  # every tenth while idle
    assert any(b"Ov:" in report for report in reports)


def test_the_simulated_planner_takes_fifteen_moves() -> None:
    grbl = Grbl(World(), length_m=4.0)
    assert grbl.handle(b"G91 G1 X1 F60\n" * 20) == b"ok\r\n" * 15
