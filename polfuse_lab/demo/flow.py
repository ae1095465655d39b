"""The demo's steps, one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from polfuse_lab.demo import files
from polfuse_lab.demo.collect_checks import collect_checks
from polfuse_lab.demo.drawing import Drawing
from polfuse_lab.demo.optics_checks import optics_checks
from polfuse_lab.demo.radar_checks import (
    calibration_checks,
    method_checks,
    place_checks,
    resolution_checks,
    target_spec,
)
from polfuse_lab.demo.thesis_checks import thesis_checks
from polfuse_lab.engine import Finished, StatusEvent, collect
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import load_plan
from polfuse_lab.products.calibrate import CalibrationResult, calibrate
from polfuse_lab.products.checks import Check, write_checks
from polfuse_lab.products.focus import focus
from polfuse_lab.products.fuse import fuse
from polfuse_lab.products.optics import optics
from polfuse_lab.report.builder import report
from polfuse_lab.report.pictures import Picture
from polfuse_lab.rig import load_rig
from processing.scene.model import Reflector, Scene

Simulator = Callable[[Path, Path], AbstractContextManager[object]]
"""Starts the simulated rig that looks at a scene file and writes the rig file that reaches it; ends it on leaving."""
StatusListener = Callable[[StatusEvent], None]


@dataclass(frozen=True)
class DemoResult:
    """What the demo made, and whether it is right."""

    session: Path
    products: Path
    report: Path
    figures: list[Path]
    checks: list[Check]
    seconds: float

    @property
    def ok(self) -> bool:
        """Whether every check holds."""
        return all(check.ok for check in self.checks)


def demo(
    out: Path,
    scene: Scene,
    *,
    sweeps: int,
    simulate: Simulator,
    quick: bool = False,
    say: Callable[[str], None] = lambda _: None,
    on_status: StatusListener | None = None,
) -> DemoResult:
    """Do the main job on a simulated rig and check what comes out of it against the scene.

    Args:
        out: directory for all files; a session in it is never overwritten.
        scene: what ``scene.toml`` of this package says, for the truth.
        sweeps: sweeps per channel and position, the simulator's ``noise_cycle``.
        simulate: starts a simulated rig.
        quick: fewer positions and frames.
        say: told of each step.
        on_status: told of the collects' progress.

    Raises:
        PolfuseError: the directory holds a session already, or a step failed.
        DeviceError: a simulated device failed.
        DataError: the data cannot be processed.
    """
    begun = time.monotonic()
    session, sky, products, compared = (out / name for name in ("session.h5", "sky.h5", "products.h5", "rma.h5"))
    for path in (session, sky, products, compared):
        if path.exists():
            raise PolfuseError(f"holds {path.name} already", where=str(out), advice="choose another directory")
    text = files.scene_text()
    scene_path = files.write_text(out / "scene.toml", text)
    sky_scene = files.write_text(out / "scene_sky.toml", files.without_targets(text))
    plan_path = files.write_text(out / "plan.toml", files.plan_text(quick=quick, sweeps=sweeps))
    sky_plan = files.write_text(out / "plan_sky.toml", files.sky_plan_text(sweeps=sweeps))

    with Drawing(products) as drawing:
        say("looking at the sky")
        with simulate(sky_scene, out / "rig_sky.toml"):
            _collect(out / "rig_sky.toml", sky_plan, sky, on_status)
        say("collecting along the rail")
        with simulate(scene_path, out / "rig.toml"):
            outcome = _collect(out / "rig.toml", plan_path, session, on_status)
        say("polarization of the light")
        optics(session, products)
        drawing.draw("optics")
        say("focusing, twice: back-projection and range migration")
        # A Taylor window along the aperture as well: side lobes of the strong targets would hide the bush.
        focus(session, products, method="bp", aperture="taylor", sky=sky)
        drawing.draw("ranging")
        focus(session, compared, method="rma", aperture="taylor", sky=sky)
        say("calibrating and fusing")
        calibration = _calibrate(products, scene, sky, load_rig(out / "rig.toml").geometry.antenna_height_m)
        drawing.draw("calibration", "polarimetry")
        fuse(products)
        drawing.draw("fusion")
        say("checking")
        checks = [
            *collect_checks(outcome, load_plan(plan_path)),
            *place_checks(products, scene),
            *resolution_checks(products, scene),
            *calibration_checks(calibration, scene),
            *optics_checks(products, scene),
            *method_checks(products, compared, scene),
            *thesis_checks(),
        ]
        write_checks(products, checks, inputs=[scene_path, session, compared])
        say("drawing and reporting")
        pictures = drawing.pictures()
    figures = [_write_picture(out / "figures", picture) for picture in pictures]
    page = report(products, out / "report.html", title=f"Demo: {scene.name}", pictures=pictures)
    return DemoResult(session, products, page, figures, checks, time.monotonic() - begun)


def _write_picture(folder: Path, picture: Picture) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / f"{picture.name}.png"
    path.write_bytes(picture.png)
    return path


def _collect(rig: Path, plan: Path, session: Path, on_status: StatusListener | None) -> Finished:
    outcome = collect(rig, plan, session, on_status=on_status)
    if outcome.state == "aborted":
        raise KeyboardInterrupt
    if outcome.state != "finished":
        raise PolfuseError(
            f"the collect did not finish ({outcome.reason})",
            where=str(session),
            advice="end what else keeps this computer busy and run the demo again",
        )
    return outcome


def _calibrate(products: Path, scene: Scene, sky: Path, antenna_height_m: float) -> CalibrationResult:
    def first(kind: str) -> Reflector:
        return next(item for item in scene.reflectors if item.kind == kind)

    ground = -antenna_height_m
    target, check = target_spec(first("trihedral"), ground), target_spec(first("dihedral"), ground)
    return calibrate(products, target, sky=sky, check=check)
