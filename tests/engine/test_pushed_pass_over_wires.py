"""A trolley pushed by hand in one go, measured by an encoder at the wire: its picture is as sharp as a driven one's."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from test_pass_over_wires import FIELD, LENGTH_M, POINT_M, width_m

from hw_mocks.encoder import Encoder, start_encoder
from hw_mocks.rig import SimulatedRig
from hw_mocks.world import World
from polfuse_lab.engine import EngineClient, Prompt, collect
from polfuse_lab.products.focus import default_grid, focus
from polfuse_lab.products.passes import pass_sweeps
from polfuse_lab.session import info, open_session

pytestmark = pytest.mark.realtime

PER_M = 10_000.0
PLAN = f"""\
kind = "continuous_sar"
drive = "encoder"
aperture_m = {LENGTH_M}
block_s = 0.5
channels = ["HH"]
move_settle_s = 0.0
"""
PACES_M_S = (0.18, 0.3, 0.22, 0.28)
"""A hand is not even."""


def pushed_rig(text: str, port: str, length_m: float) -> str:
    """The simulated rig's file with a trolley that is pushed."""
    before, _, after = text.partition("[trolley]")
    following = re.search(r"^\[(?!trolley)", after, flags=re.M)
    rest = after[following.start() :] if following else ""
    return (
        f'{before}[trolley]\ndriver = "encoder"\nlength_m = {length_m}\nspeed_m_s = 0.25\n'
        f'[trolley.options]\nport = "{port}"\nlength_m = {length_m}\ncounts_per_m = {PER_M}\nstart_x_m = 0.0\n'
        f"tolerance_m = 0.02\n\n{rest}"
    )


def pusher(encoder: Encoder, world: World) -> Callable[[EngineClient, Prompt], None]:
    """Somebody who pushes where the prompt says, unevenly."""

    def ask(client: EngineClient, prompt: Prompt) -> None:
        found = re.search(r"x = ([+-]?[\d.]+) m", prompt.text)
        assert found is not None, prompt.text
        threading.Thread(target=push, args=(float(found.group(1)),), daemon=True).start()

    def stands_m() -> float:
        return float(world.trolley_x_m.at(time.monotonic_ns()))

    def push(x_m: float) -> None:
        start = stands_m()
        for number, pace in enumerate(PACES_M_S, start=1):
            part = start + (x_m - start) * number / len(PACES_M_S)
            way = abs(part - stands_m())
            encoder.push(part, pace)
            time.sleep(way / pace)

    return ask


def test_the_point_is_as_sharp_as_from_a_driven_pass(tmp_path: Path) -> None:
    head = FIELD.read_text().split("# Radar targets.")[0]
    scene = tmp_path / "scene.toml"
    point = f"position_m = [{POINT_M[0]}, {POINT_M[1]}, -1.069]\nrcs_dbsm = 15.0\n"
    scene.write_text(f'{head}\n[[point]]\nname = "point"\n{point}')
    (tmp_path / "plan.toml").write_text(PLAN)
    with (
        SimulatedRig(scene, tmp_path / "rig", audio="tcp", seed=2) as rig,
        start_encoder(rig.world, counts_per_m=PER_M) as wire,
    ):
        assert isinstance(wire.handler, Encoder)
        path = tmp_path / "rig.toml"
        path.touch(mode=0o600)
        path.write_text(pushed_rig(rig.rig_toml(), wire.url, rig.file.rail.length_m))
        session_path = tmp_path / "s.h5"
        outcome = collect(path, tmp_path / "plan.toml", session_path, on_prompt=pusher(wire.handler, rig.world))
        rig.check()
    assert outcome.state == "finished", outcome.reason
    assert [problem for problem in info(session_path)["problems"] if "taken again" not in problem] == []
    with open_session(session_path) as session:
        (run,) = pass_sweeps(session)
        # The encoder's own: 0.1 mm a count, 2 mm at its start and 0.2 % of the way.
        assert np.nanmax(run.sd_m) < 0.01
        grid = default_grid(session, x_m=(-1.5, 2.0), y_m=(4.0, 8.0), step_m=(0.02, 0.1))
        result = focus(session, tmp_path / "products.h5", grid=grid, peaks=1)
    image, peak = np.abs(result.image[0]), result.peaks[0]
    # As for the driven pass: a tenth of a cell along the rail and in range.
    assert peak.x_m == pytest.approx(POINT_M[0], abs=0.043)
    assert peak.y_m == pytest.approx(POINT_M[1], abs=0.2)
    row = image[int(np.argmin(np.abs(grid.y_m - peak.y_m)))]
    slant = math.hypot(POINT_M[1], 1.069)
    # Sweeps are averaged in cells of 1/16 wavelength, so that the uneven pace leaves the aperture evenly weighted.
    assert width_m(row, grid.x_m) == pytest.approx(0.886 * 0.1249 * slant / (2 * LENGTH_M), rel=0.04)
