"""``polfuse demo``: the main job on a simulated rig."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, progress, result

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

START_S = 60.0
"""Time that the simulated rig may take to start, s."""


@guarded
def demo(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Where to put everything [a new directory here].")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all noise; one seed, one result to the last bit.")] = 1,
    quick: Annotated[bool, typer.Option("--quick", help="A short rail: well under a minute.")] = False,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Do the main job on a simulated rig: collect, focus, calibrate, optics, fuse, report; check it against the truth.

    The devices are simulated, everything else is real: serial lines, sound card (where PulseAudio is there), engine.

    Example: polfuse demo --out demo --quick
    """
    import time

    begun = time.monotonic()
    from hw_mocks.scene_file import load_scene_file
    from polfuse_lab.cli.terminal import StatusLine, interrupt_on_sigterm
    from polfuse_lab.demo import files, flow
    from polfuse_lab.products.checks import as_json

    out = Path(time.strftime("polfuse_demo_%Y%m%d_%H%M%S")) if out is None else out
    file = load_scene_file(files.write_text(out / "scene.toml", files.scene_text()))
    line = StatusLine()

    def say(step: str) -> None:
        line.end()
        progress(f"{time.monotonic() - begun:5.1f} s  {step}")

    @contextmanager
    def simulate(scene: Path, rig: Path) -> Iterator[None]:
        # The sky's noise is another noise than the scene's.
        with simulated_rig(scene, rig, 2 * seed + (scene.name != "scene.toml")):
            yield

    with interrupt_on_sigterm():
        made = flow.demo(
            out,
            file.scene(),
            sweeps=file.audio.noise_cycle,
            simulate=simulate,
            quick=quick,
            say=say,
            on_status=line.show,
        )
    line.end()
    failed = [check for check in made.checks if not check.ok]
    values = {
        "session": made.session,
        "products": made.products,
        "report": made.report,
        "figures": made.figures,
        "checks": as_json(made.checks),
        "ok": made.ok,
        "seconds": time.monotonic() - begun,
    }
    text = f"{len(made.checks) - len(failed)} of {len(made.checks)} checks passed; look at {made.report}"
    result(values, as_json=json_, text=text)
    if failed:
        names = ", ".join(f"{c.name} ({c.value:.4g}, expected {c.expected:.4g} ± {c.tolerance:.2g})" for c in failed)
        progress(f"error: {made.report}: {len(failed)} checks failed: {names}; run it again on an idle computer")
        raise typer.Exit(1)


@contextmanager
def simulated_rig(scene: Path, rig: Path, seed: int) -> Iterator[None]:
    """Run a simulated rig in a process of its own; it ends with this block, or when this process ends.

    Raises:
        PolfuseError: it cannot be started.
    """
    import multiprocessing

    from polfuse_lab.errors import PolfuseError

    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(scene, rig, seed, there), name="simulated rig", daemon=True)
    process.start()
    there.close()
    try:
        try:
            answer = here.recv() if here.poll(START_S) else f"no answer in {START_S:.0f} s"
        except EOFError:
            answer = "its process ended"
        if answer != "ready":
            raise PolfuseError(
                f"the simulated rig did not start ({answer})",
                where=str(scene),
                advice="run 'polfuse sim' on this scene to see why",
            )
        yield
    finally:
        here.close()
        process.join(10)
        if process.is_alive():
            process.kill()
            process.join(5)


def _serve(scene: Path, rig_path: Path, seed: int, pipe: Connection) -> None:
    import signal
    import tempfile

    from hw_mocks.rig import SimulatedRig

    # Ctrl-C reaches all processes of a terminal: devices stay alive until the engine has closed them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with (
            tempfile.TemporaryDirectory(prefix="polfuse-demo-") as directory,
            SimulatedRig(scene, directory, seed=seed) as rig,
        ):
            rig.write_rig(rig_path)
            pipe.send("ready")
            # The pipe's other end closes when the demo is done, or has died.
            while not pipe.poll(0.2):
                rig.check()
    except Exception as error:
        try:
            pipe.send(f"{error}")
        except OSError:
            return
