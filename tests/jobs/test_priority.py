"""Niceness of a process and of its session, as the system tells them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

GROUP = Path("/proc/self/autogroup")

# The file is there and empty for processes that no session's group holds (those of the kernel's root group).
TOLD = """
import json, os, sys
from pathlib import Path
from polfuse_lab.priority import give_way
read = lambda: Path(sys.argv[1]).read_text().split()[-1:]
before = read()
give_way(6)
print(json.dumps([os.nice(0), before, read()]))
"""


@pytest.mark.skipif(not GROUP.exists(), reason="this system has no groups of processes by session")
@pytest.mark.parametrize("own_session", [True, False])
def test_who_leads_a_session_lowers_all_of_it(own_session: bool) -> None:
    """sched(7): within an autogroup niceness counts among its members only; the group has a niceness of its own."""
    done = subprocess.run(
        [sys.executable, "-c", TOLD, str(GROUP)],
        capture_output=True,
        text=True,
        check=True,
        start_new_session=own_session,
    )
    nice, before, after = json.loads(done.stdout)
    assert nice == os.nice(0) + 6
    assert after == (["6"] if own_session and before else before)
