"""What docs/drivers.md shows is so: every driver is there, its lines are lines, its code gives what it says, and the
encoder's sketch, compiled for this computer, says what the driver understands."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from drivers.registry import KINDS, available, driver_class
from drivers.trolley.encoder_protocol import EncoderLine, parse_line
from drivers.trolley.encoder_track import EncoderTrack, Scale

HERE = Path(__file__).parent
PAGE = (HERE.parents[1] / "docs" / "drivers.md").read_text(encoding="utf-8")

MAIN = """
#include "arduino_stand_in.h"
%s
static void set(int pin, int level) {
  if (pins[pin] == level) return;
  pins[pin] = level;
  if (on_edge[pin]) on_edge[pin]();
}
int main() {
  static const int a[] = {0, 0, 1, 1}, b[] = {0, 1, 1, 0};
  setup();
  int phase = 0;
  for (int i = 0; i < 4000; i++) {
    int direction = i < 3000 ? 1 : -1;
    if (i == 100) set(4, 1);   // the index mark, reached at the next edge
    if (i == 105) set(4, 0);
    phase = (phase + 4 + direction) %% 4;
    set(2, a[phase]);
    set(3, b[phase]);
    now_us += 500;
    loop();
  }
}
"""


def listing(language: str) -> str:
    found = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert len(found) == 1
    return str(found[0])


def test_every_driver_and_what_it_is_asked_for_is_on_the_page() -> None:
    for kind in KINDS:
        for name in available(kind):
            if driver_class(kind, name).__module__.split(".")[0] in ("drivers", "hw_mocks"):
                assert f"`{name}`" in PAGE, f"{kind} {name}"


def test_options_named_on_the_page_exist() -> None:
    known = {
        field for kind in KINDS for name in available(kind)
        for field in driver_class(kind, name).Options.__dataclass_fields__
    }  # fmt: skip
    named = set(
        re.findall(r"`([a-z]+(?:_[a-z]+)*_(?:m|s|relay|first|folder|cycles|percent|open|deg))(?: = [^`]*)?`", PAGE)
    )
    assert named > {"settle_s", "stagger_s", "home_first", "index_x_m"}
    assert named - known - {name for kind in KINDS for name in available(kind)} == set()


def test_the_lines_shown_are_lines() -> None:
    first, second = listing("text").splitlines()
    assert parse_line(first) == EncoderLine(7, 1_234_567, 2**32 - 100, None)
    assert parse_line(second) == EncoderLine(8, 1_244_567, 20, 15)


def test_the_calibration_shown_prints_what_its_comments_say() -> None:
    code = listing("python")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, "drivers.md", "exec"), {})
    assert printed.getvalue().splitlines() == re.findall(r"print\(.*?\)  # (.*)", code)


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler here")
def test_the_sketch_counts_and_its_lines_are_understood(tmp_path: Path) -> None:
    source = tmp_path / "sketch.cpp"
    source.write_text(MAIN % listing("cpp"))
    program = tmp_path / "sketch"
    subprocess.run(["g++", "-Wall", "-Wextra", "-Werror", f"-I{HERE}", "-o", program, source], check=True, timeout=60)
    said = subprocess.run([program], capture_output=True, check=True, timeout=10).stdout.decode()
    lines = [parse_line(line) for line in said.splitlines()]
    assert said.count("\r\n") == len(lines)
    # 4000 steps of 0.5 ms, a line every 10 ms.
    assert 195 <= len(lines) <= 201
    track = EncoderTrack(Scale(1000.0, 0.0, 1e-3, None, 32, 50.0), 0.0)
    for number, line in enumerate(lines):
        assert line is not None
        track.add(line, number * 10_000_000)
    # 3000 edges one way and 1000 back, at 1000 counts per metre; a step of the encoder is one count.
    assert abs(track.last_x_m) == pytest.approx(2.0, abs=0.02)
    assert track.lost_lines == 0
    last = lines[-1]
    assert last is not None
    assert last.index is not None
    # The mark came up between the hundredth edge and the next.
    assert abs((last.index + 2**31) % 2**32 - 2**31) == pytest.approx(101, abs=1)
