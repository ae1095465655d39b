"""Shared by the tests of GRBL: a driver, a simulated controller, and the bytes of an opening."""

from __future__ import annotations

from typing import Any

from drivers.trolley.grbl import GrblTrolley
from hw_mocks.grbl import Grbl
from hw_mocks.wire import Kind, Wire, serve
from hw_mocks.world import World

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
IDLE = b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
OPENING = [
    (b"?", IDLE),
    (b"!", b""),
    (b"?", IDLE),
    (b"\x18", BANNER),
    (b"?", b"<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"),
    (b"$I\n", b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"),
    (b"$$\n", b"$13=0\r\n$100=250.000\r\n$110=6000.000\r\nok\r\n"),
    (b"?", IDLE),
]


def driver(url: str, **options: Any) -> GrblTrolley:
    given = {"length_m": 4.0, "feed_m_s": 1.0, "timeout_s": 1.0, "poll_interval_s": 0.005} | options
    return GrblTrolley(GrblTrolley.Options(port=url, **given))


def simulated(world: World, kind: Kind | None = None, **options: Any) -> Wire:
    return serve(Grbl(world, **({"length_m": 4.0, "feed_limit_m_s": 5.0} | options)), kind=kind)
