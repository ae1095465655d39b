"""The driver of docs/write-a-driver.md is real: taken from the page, installed as a package, found, checked and run."""

from __future__ import annotations

import importlib
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from contract_checks import faults_of_class, faults_of_options

from drivers.contracts import Switches
from drivers.errors import DeviceBadAnswer, DeviceRefused, DeviceTimeout
from drivers.records import Channel
from drivers.registry import available, driver_class
from hw_mocks.wire import serve
from polfuse_lab.doctor import examine
from polfuse_lab.rig import FileMistake, load_rig

PAGE = Path(__file__).resolve().parents[2] / "docs" / "write-a-driver.md"
RIG = """\
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = 1.0
[radar]
driver = "sounddevice"
[trolley]
driver = "by_hand"
length_m = 3.0
"""


class Controller:
    """The microcontroller that the page describes."""

    def __init__(self) -> None:
        self.route, self.reply, self.heard = "HH", "", b""

    def handle(self, received: bytes) -> bytes:
        self.heard += received
        said = b""
        for line in re.findall(rb"([^\n]*)\n", received):
            if line.startswith(b"R ") and not self.reply:
                self.route = line[2:].decode()
            said += (self.reply or f"OK {self.route}").encode() + b"\r\n"
        return said

    def due_s(self) -> float | None:
        return None


def blocks() -> dict[str, str]:
    """The page's listings: by the file name on the line before, the rig file's part as ``rig``."""
    found = {}
    for name, _, text in re.findall(r"(?:`([\w.]+)`:\n\n)?```(python|toml)\n(.*?)```", PAGE.read_text(), re.DOTALL):
        found[name or "rig"] = text
    return found


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, str]]:
    """The page's package, installed in a folder of its own that is put on the path."""
    listings = blocks()
    (tmp_path / "lab_switches.py").write_text(listings["lab_switches.py"])
    project = tomllib.loads(listings["pyproject.toml"])["project"]
    info = tmp_path / f"lab_switches-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    points = project["entry-points"]
    text = "".join(
        f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in names.items()) for group, names in points.items()
    )
    (info / "entry_points.txt").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    yield listings
    sys.modules.pop("lab_switches", None)


def test_the_listing_is_complete_and_under_sixty_lines() -> None:
    listings = blocks()
    assert set(listings) == {"lab_switches.py", "pyproject.toml", "rig"}
    assert len(listings["lab_switches.py"].splitlines()) < 60


def test_it_is_found_and_keeps_the_contract(installed: dict[str, str]) -> None:
    assert "lab_switches" in available("switches")
    cls = driver_class("switches", "lab_switches")
    assert faults_of_class(cls, "switches") == []
    assert faults_of_options(cls.Options) == []


def test_it_drives_its_switches(installed: dict[str, str]) -> None:
    cls: Any = driver_class("switches", "lab_switches")
    controller = Controller()
    with serve(controller) as wire:
        switches = cls(cls.Options(port=wire.url, settle_s=0.0))
        assert isinstance(switches, Switches)
        switches.make_safe()  # never opened: nothing happens
        assert switches.open().detail == "route HH"
        state = switches.select(Channel.HV)
        assert (state.transmit, state.receive) == ("H", "V")
        assert switches.state().receive == "V"
        assert controller.heard == b"R?\nR HV\nR?\nR?\n"
        controller.reply = "NO supply"
        with pytest.raises(DeviceRefused, match="refused 'R VV': supply; check its supply"):
            switches.select(Channel.VV)
        controller.reply = "what?"
        with pytest.raises(DeviceBadAnswer):
            switches.state()
        controller.reply = ""
        switches.make_safe()
        assert controller.route == "HH"
        wire.filter = lambda said: b""
        with pytest.raises(DeviceTimeout):
            switches.state()
        switches.close()
        switches.close()


def test_a_rig_file_with_it_is_checked_like_any_other(installed: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(RIG + installed["rig"])
    assert load_rig(path).switches.driver == "lab_switches"
    path.write_text(RIG + installed["rig"] + "colour = 1\n")
    with pytest.raises(FileMistake, match=r"line \d+, switches\.options\.colour: found 1, allowed: port, settle_s"):
        load_rig(path)
    controller = Controller()
    with serve(controller) as wire:
        path.write_text(RIG + installed["rig"].replace("/dev/ttyACM1", wire.url))
        findings = {finding.kind: finding for finding in examine(path)}
    assert (findings["switches"].ok, findings["switches"].detail) == (True, "lab switches route HH")
    assert controller.route == "HH"


def test_without_the_package_the_rig_file_says_what_is_installed(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(RIG + blocks()["rig"])
    with pytest.raises(
        FileMistake, match=r"switches\.driver: found 'lab_switches', allowed: dowkey_ms, minicircuits_rc"
    ):
        load_rig(path)
