"""GRBL 1.1: status reports, errors and settings. The lines are those of real GRBL 1.1h firmware."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import DeviceBadAnswer
from drivers.trolley.grbl_protocol import explain, parse_report, parse_setting


def test_reports_of_the_real_firmware() -> None:
    report = parse_report("<Run|MPos:2.260,0.000,0.000|FS:432,0|Pn:RHS|Ov:100,100,100>", None, "here")
    assert (report.state, report.substate, report.machine_mm) == ("Run", None, (2.26, 0.0, 0.0))
    assert parse_report("<Hold:1|MPos:1.000,0.000,0.000|FS:0,0>", None, "here").name == "Hold:1"
    assert parse_report("<Alarm|MPos:-5.5,0,0>", None, "here").machine_mm == (-5.5, 0.0, 0.0)


def test_work_offset_is_remembered() -> None:
    # Machine position = work position + offset (GRBL 1.1 interface description).
    unknown = parse_report("<Idle|WPos:1.000,2.000,3.000|FS:0,0>", None, "here")
    assert unknown.machine_mm is None
    first = parse_report("<Idle|WPos:1.000,2.000,3.000|FS:0,0|WCO:10.000,0.000,-1.000>", None, "here")
    assert first.machine_mm == (11.0, 2.0, 2.0)
    later = parse_report("<Run|WPos:2.000,2.000,3.000|FS:10,0>", first.work_offset_mm, "here")
    assert later.machine_mm == (12.0, 2.0, 2.0)


@pytest.mark.parametrize(
    "line",
    ["<>", "<Idle>", "<Idle,MPos:0.000,0.000,0.000>", "<Idle|MPos:a,b,c>", "<Idle|MPos:nan,0,0>", "<Idle|MPos:>",
     "<Idle|FS:0,0>", "<idle|MPos:0,0,0>", "<Idle|MPos:1,2,3", "<Idle|WPos:1,2,3|WCO:1>", "<Idle|MPos:1,2,3,4,5,6,7>"],
)  # fmt: skip
def test_what_is_no_report(line: str) -> None:
    with pytest.raises(DeviceBadAnswer, match="here"):
        parse_report(line, None, "here")


@given(st.one_of(st.text(max_size=60), st.from_regex(r"<[A-Z][a-z]{1,6}(:\d)?(\|[MW](Pos|CO):[-\d.,e]{0,12}){0,3}>")))
@settings(max_examples=150, deadline=None)
def test_fuzz_reports(line: str) -> None:
    explain(line)
    parse_setting(line)
    try:
        report = parse_report(line, (1.0, 2.0, 3.0), "here")
    except DeviceBadAnswer:
        return
    assert report.machine_mm is not None
    assert all(math.isfinite(mm) for mm in report.machine_mm)


def test_words_for_codes() -> None:
    assert explain("error:9") == "error:9 (G-code is locked while it is in alarm or jogging)"
    assert explain("ALARM:3") == "ALARM:3 (it was reset while moving, the position is probably lost)"
    assert "does not list" in explain("error:99")
    assert explain("error:") == "error:"
