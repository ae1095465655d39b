"""``polfuse sim``: run the simulated devices."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, progress, result


@guarded
def sim(
    scene: Annotated[Path, typer.Argument(help="Scene file (TOML).")],
    rig_out: Annotated[Path, typer.Option("--rig-out", help="Rig file to write; it reaches the simulated devices.")],
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of all noise; the scene file's own if left out.")
    ] = None,
    audio: Annotated[
        Literal["auto", "pulse", "tcp"],
        typer.Option(help="How the sound card is reached; auto takes the best there is."),
    ] = "auto",
    camera: Annotated[
        Literal["scene", "gige"],
        typer.Option(help="How the camera is reached: by itself, or as a GigE Vision camera on loopback (Linux)."),
    ] = "scene",
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="DEVICE:KIND[:after=5s][:for=2s][:amount=X]",
            help="A fault to practise with, such as trolley:silence:after=5s:for=2s; may be repeated. Without the s,"
            " 'after' and 'for' count what the device does.",
        ),
    ] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Start a simulated rig, write the rig file that reaches it, and run until Ctrl-C.

    Switches, trolley and polarizer are serial devices, the radar is a sound card, the camera looks at the same scene;
    with --camera gige it is on the network, and drivers reach it through the GenTL producer ('make gentl'). What both
    eyes have of a scene of bodies is traced before the devices start.

    Example: polfuse sim examples/scenes/field.toml --rig-out rig.toml
    """
    import signal
    import tempfile
    import threading
    import time

    from drivers.camera.producers import ARAVIS, find_producer
    from hw_mocks.faults import parse_fault
    from hw_mocks.rig import SimulatedRig
    from hw_mocks.scene_file import load_scene_file
    from polfuse_lab.simulation.rig_scene import read_bodies

    try:
        faults = [parse_fault(text) for text in fault or ()]
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--fault") from None
    if camera == "gige":
        find_producer(ARAVIS, "simulated GigE camera")
    file = load_scene_file(scene)
    bodies = read_bodies(scene, file.waveform.centre_hz) if file.solid else None
    told = time.monotonic()

    def tell(eye: str, done: float) -> None:
        nonlocal told
        if time.monotonic() - told > 2:
            told = time.monotonic()
            progress(f"{eye}: {100 * done:.0f} %")

    stop = threading.Event()
    previous = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with (
            tempfile.TemporaryDirectory(prefix="polfuse-sim-") as directory,
            SimulatedRig(scene, directory, seed=seed, audio=audio, camera=camera, bodies=bodies, progress=tell) as rig,
        ):
            rig.arm(faults)
            rig.write_rig(rig_out)
            lines = [f"{name:13} {address}" for name, address in rig.endpoints.items()]
            text = "\n".join([f"simulated rig '{rig.file.name}', rig file {rig_out}", *lines])
            result({"endpoints": rig.endpoints, "rig": rig_out}, as_json=json_, text=text)
            progress("running; Ctrl-C ends it")
            while not stop.wait(0.2):
                rig.check()
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
