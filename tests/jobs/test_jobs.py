"""Jobs: progress, results in their place, errors in words, cancel with nothing left, and a queue."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from polfuse_lab import jobs
from polfuse_lab.errors import PolfuseError
from polfuse_lab.jobs import expected
from polfuse_lab.jobs import queue as queues
from polfuse_lab.jobs.scratch import Scratch
from polfuse_lab.jobs.specs import JobSpec, Made
from polfuse_lab.products.store import Products

pytestmark = pytest.mark.realtime


@pytest.fixture
def queue():
    made = jobs.JobQueue()
    yield made
    made.close()


@pytest.fixture
def stand_in(monkeypatch, tmp_path):
    """A command in place of polfuse, as quick as a process is: a Python script that speaks as the runner does."""
    script = tmp_path / "stand_in.py"

    def become(text):
        script.write_text("import json, sys, time, pathlib\n" + text)
        real = subprocess.Popen

        def start(command, **options):
            return real([sys.executable, str(script), *command[3:]], **options)

        monkeypatch.setattr(queues.subprocess, "Popen", start)

    return become


def until(condition, seconds=30.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def spec(out, *words, inputs=()):
    return JobSpec("focus", "a job", ("focus", *words, Made(Path(out).absolute())), tuple(inputs))


def left(folder):
    return [path.name for path in folder.iterdir() if path.name.startswith(".polfuse")]


TELL = """
def tell(**what): print(json.dumps(what), flush=True)
"""


def test_a_job_tells_how_far_it_is_and_what_it_made(queue, stand_in, tmp_path):
    stand_in(
        TELL
        + """
for part in range(3):
    tell(told=f"part {part}", fraction=part / 3, left_s=3.0 - part)
    time.sleep(0.3)
print("a note", file=sys.stderr)
pathlib.Path(sys.argv[-1]).write_text("made")
tell(result={"products": sys.argv[-1], "nested": [{"file": sys.argv[-1] + "x"}]})
"""
    )
    seen = []
    queue.on_change(lambda job: seen.append((job.state, job.progress)))
    job = queue.submit(spec(tmp_path / "p.txt"))
    until(lambda: job.over)
    assert job.state == "done"
    assert (tmp_path / "p.txt").read_text() == "made"
    # Paths are those that things have now, wherever they stand.
    assert job.result == {"products": str(tmp_path / "p.txt"), "nested": [{"file": str(tmp_path / "p.txtx")}]}
    assert job.paths == (tmp_path / "p.txt",)
    assert "a note" in job.details
    assert left(tmp_path) == []
    states = [state for state, _ in seen]
    assert states[0] == "waiting"
    assert states[-1] == "done"
    fractions = [progress.fraction for state, progress in seen if state == "running" and progress.fraction is not None]
    assert fractions == sorted(fractions)
    assert {1 / 3, 2 / 3} & set(fractions)
    assert job.progress.fraction == 1.0


def test_a_job_that_fails_says_why_and_leaves_things_as_they_were(queue, stand_in, tmp_path):
    stand_in(
        """
pathlib.Path(sys.argv[-1]).write_text("half")
print("Traceback: many lines", file=sys.stderr)
print("error: s.h5: holds nothing; record again", file=sys.stderr)
sys.exit(1)
"""
    )
    (tmp_path / "p.txt").write_text("old")
    job = queue.submit(spec(tmp_path / "p.txt"))
    until(lambda: job.over)
    assert job.state == "failed"
    assert job.error == "s.h5: holds nothing; record again"
    assert "Traceback" in job.details
    assert (tmp_path / "p.txt").read_text() == "old"
    assert left(tmp_path) == []


def test_a_job_that_dies_says_how(queue, stand_in, tmp_path):
    stand_in("import os\nos.kill(os.getpid(), 9)\n")
    job = queue.submit(spec(tmp_path / "p.txt"))
    until(lambda: job.over)
    assert job.state == "failed"
    assert "signal 9" in job.error


def test_cancel_is_over_within_a_second_with_nothing_left(queue, stand_in, tmp_path):
    stand_in(
        """
import subprocess
pathlib.Path(sys.argv[-1]).write_text("half")
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
pathlib.Path(sys.argv[-1] + ".pid").write_text(str(child.pid))
print(json.dumps({"told": str(child.pid)}), flush=True)
time.sleep(60)
"""
    )
    job = queue.submit(spec(tmp_path / "p.txt"))
    until(lambda: job.progress.words.isdigit())
    child = int(job.progress.words)
    begun = time.monotonic()
    job.cancel()
    assert job.state == "cancelled"
    until(lambda: not left(tmp_path))
    assert time.monotonic() - begun < 1.0
    assert not (tmp_path / "p.txt").exists()
    until(lambda: _gone(child))
    job.cancel()  # nothing more happens
    # The queue goes on.
    stand_in('pathlib.Path(sys.argv[-1]).write_text("x")\nprint(json.dumps({"result": {}}))\n')
    following = queue.submit(spec(tmp_path / "q.txt"))
    until(lambda: following.over)
    assert following.state == "done"


def _gone(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return True
    return state == "Z"


def test_jobs_are_done_in_their_order_and_waiting_ones_can_be_cancelled(queue, stand_in, tmp_path):
    stand_in('time.sleep(0.2)\npathlib.Path(sys.argv[-1]).touch()\nprint(json.dumps({"result": {}}))\n')
    order = []
    queue.on_change(lambda job: order.append(job.number) if job.state == "done" else None)
    made = [queue.submit(spec(tmp_path / f"{number}.txt")) for number in range(4)]
    made[2].cancel()
    until(lambda: all(job.over for job in made))
    assert order == [1, 2, 4]
    assert not (tmp_path / "2.txt").exists()
    assert [job.number for job in queue.jobs] == [1, 2, 3, 4]
    queue.forget(made[0])
    assert [job.number for job in queue.jobs] == [2, 3, 4]


def test_several_at_once(stand_in, tmp_path):
    stand_in('time.sleep(0.5)\npathlib.Path(sys.argv[-1]).touch()\nprint(json.dumps({"result": {}}))\n')
    queue = jobs.JobQueue(at_once=3)
    made = [queue.submit(spec(tmp_path / f"{number}.txt")) for number in range(3)]
    until(lambda: all(job.state == "running" for job in made))
    until(lambda: all(job.over for job in made))
    queue.close()


def test_a_closed_queue_cancels_and_takes_no_more(stand_in, tmp_path):
    stand_in("time.sleep(60)\n")
    queue = jobs.JobQueue()
    running, waiting = queue.submit(spec(tmp_path / "a")), queue.submit(spec(tmp_path / "b"))
    until(lambda: running.state == "running")
    queue.close()
    assert running.state == waiting.state == "cancelled"
    assert left(tmp_path) == []
    with pytest.raises(PolfuseError, match="no jobs"):
        queue.submit(spec(tmp_path / "c"))
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("jobs ")]


def test_a_folder_that_is_not_there_is_said(queue, tmp_path):
    job = queue.submit(spec(tmp_path / "nowhere" / "p.txt"))
    until(lambda: job.over)
    assert job.state == "failed"
    assert "cannot be written" in job.error


def test_the_time_of_earlier_jobs_is_what_the_next_one_is_expected_to_take(queue, stand_in, tmp_path):
    stand_in('time.sleep(0.7)\npathlib.Path(sys.argv[-1]).touch()\nprint(json.dumps({"result": {}}))\n')
    data = tmp_path / "data"
    data.write_bytes(bytes(1000))
    assert expected.expected_s("focus", 1000) is None
    first = queue.submit(spec(tmp_path / "a", inputs=[data]))
    until(lambda: first.over)
    told = expected.expected_s("focus", 1000)
    assert 0.6 < told < 5
    # Twice the work (its overhead counts as 20 MB) takes twice as long.
    assert expected.expected_s("focus", 1000 + expected.OVERHEAD_BYTES) == pytest.approx(2 * told, rel=1e-3)
    seen = []
    queue.on_change(lambda job: seen.append(job.progress))
    second = queue.submit(spec(tmp_path / "b", inputs=[data]))
    until(lambda: second.over)
    estimates = [progress for progress in seen if progress.estimated]
    assert estimates
    assert all(0 <= progress.fraction < 1 for progress in estimates)


@pytest.fixture
def products(tmp_path):
    path = tmp_path / "p.h5"
    Products(path).write("one", {"x": np.arange(4)}, settings={}, inputs=[], units={})
    return path


def test_a_products_file_stays_as_it_is_until_the_job_is_done(products):
    before = products.read_bytes()
    scratch = Scratch(JobSpec("fuse", "", ("fuse", Made(products, "changed"))))
    inside = Path(scratch.words[1])
    Products(inside).write("two", {"x": np.arange(5)}, settings={}, inputs=[inside], units={})
    assert products.read_bytes() == before
    (inside.parent / "p_figure.png").write_bytes(b"png")
    placed = scratch.adopt()
    assert sorted(placed) == [products, products.with_name("p_figure.png")]
    assert Products(products).stages() == ["one", "two"]
    assert left(products.parent) == []


def test_what_another_program_wrote_meanwhile_is_not_overwritten(products):
    scratch = Scratch(JobSpec("fuse", "", ("fuse", Made(products, "changed"))))
    inside = Path(scratch.words[1])
    Products(inside).write("two", {"x": np.arange(5)}, settings={}, inputs=[], units={})
    Products(products).write("three", {"x": np.arange(6)}, settings={}, inputs=[], units={})
    with pytest.raises(PolfuseError, match="another program"):
        scratch.adopt()
    scratch.discard()
    assert Products(products).stages() == ["one", "three"]


def test_an_existing_copy_is_not_replaced(tmp_path):
    (tmp_path / "copy.h5").touch()
    with pytest.raises(PolfuseError, match="there already"):
        Scratch(jobs.replay(tmp_path / "s.h5", tmp_path / "copy.h5"))
    assert left(tmp_path) == []


@pytest.mark.skipif(os.name != "posix", reason="kills a process")
def test_what_a_killed_program_left_is_removed_by_the_next_job(tmp_path):
    code = (
        "import sys, time; from pathlib import Path; from polfuse_lab.jobs.scratch import Scratch;"
        "from polfuse_lab.jobs.specs import JobSpec, Made;"
        f"Scratch(JobSpec('x', '', (Made(Path({str(tmp_path / 'a')!r})),))); print('made', flush=True); time.sleep(60)"
    )
    program = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert program.stdout.readline() == b"made\n"
    assert len(left(tmp_path)) == 1
    Scratch(spec(tmp_path / "b")).discard()
    assert len(left(tmp_path)) == 1  # its program lives
    program.send_signal(signal.SIGKILL)
    program.wait(10)
    program.stdout.close()
    Scratch(spec(tmp_path / "b")).discard()
    assert left(tmp_path) == []


def test_commands_are_as_they_would_be_typed(tmp_path):
    def typed(made):
        return [str(word.path.name) if isinstance(word, Made) else word for word in made.words]

    s, p = str(tmp_path / "s.h5"), tmp_path / "p.h5"
    assert typed(jobs.focus(s, p, tolerance_db=-60, x_m=(-8, 8), autofocus="auto", compensate_pattern=None)) == [
        "focus", s, "-o", "p.h5", "--method=auto", "--tolerance-db=-60", "--x=-8,8", "--autofocus",
        "--autofocus-method=auto",
    ]  # fmt: skip
    assert typed(jobs.calibrate(p, target="trihedral", at=(0, 8.5), check="dihedral", check_at=(2, 9))) == [
        "calibrate", "p.h5", "--target=trihedral", "--at=0,8.5", "--check-at=2,9", "--check=dihedral",
    ]  # fmt: skip
    assert typed(jobs.decompose(p, "pauli", folder=tmp_path / "d", window=5))[-2:] == ["-o", "d"]
    assert typed(jobs.fuse(p, classes=4)) == ["fuse", "p.h5", "--classes=4"]
    assert typed(jobs.report(p, tmp_path / "r.html"))[0] == "report"
    assert typed(jobs.export(p, "png", tmp_path / "out"))[2] == "--to=png"
    assert typed(jobs.range_(s))[-1] == "s_range.png"
    assert typed(jobs.replay(s, p, speed=20))[-1] == "--speed=20"
    assert typed(jobs.optics(s, p))[0] == "optics"
    assert jobs.command(["info", "x.h5"]).kind == "info"


def test_a_real_command_fails_in_words(queue, tmp_path):
    # Through the real runner: no session, so one sentence of polfuse itself.
    job = queue.submit(jobs.optics(tmp_path / "none.h5", tmp_path / "p.h5"))
    until(lambda: job.over, 90)
    assert job.state == "failed"
    assert "none.h5" in job.error
    assert "does not exist" in job.error
    assert left(tmp_path) == []


def test_a_real_command_gives_its_json(queue, tmp_path):
    job = queue.submit(jobs.command(["init", Made(tmp_path / "rig")]))
    until(lambda: job.over, 90)
    assert job.state == "done", job.error
    assert Path(job.result["rig"]).parent == tmp_path / "rig"
    assert Path(job.result["rig"]) in job.paths
    assert Path(job.result["plan"]).read_text()
    json.dumps(job.result)
