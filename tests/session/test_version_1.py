"""Files of version 1 are read as if they had been written today: what was added since says that it is not known."""

from __future__ import annotations

import h5py
import numpy as np
from session_records import config, exposure, sweeps
from version_1 import to_version_1

from drivers.records import PolarizerFix, SwitchState, TrolleyFix
from polfuse_lab.session import SessionWriter, info, open_session, recover
from polfuse_lab.session.layout import TABLES


def test_a_file_of_version_1_is_read_recovered_and_summarised(path):
    records = [
        sweeps(3),
        exposure(1),
        TrolleyFix(0.1, 0.002, False, 5, "Idle"),
        SwitchState("H", "V", True, 6),
        PolarizerFix(0.7, 0.01, False, 7),
    ]
    with SessionWriter.create(path, config()) as writer:
        for record in records:
            writer.write(record)
    to_version_1(path)
    with h5py.File(path) as file:  # it is what it says
        assert file["trolley"].dtype.names == ("x_m", "sd_m", "moving", "t_host_ns", "state")
    with open_session(path) as session:
        assert (session.schema, session.complete) == ("polfuse-session/1", True)
        for name, dtype in TABLES.items():
            assert getattr(session, name).dtype == dtype
        # Every fix was one that a step had asked for; sources had no polarizer; nothing was flagged.
        assert session.trolley.tolist() == [(0.1, 0.002, False, 5, b"Idle", -1)]
        assert session.switches["record"].tolist() == session.polarizer["record"].tolist() == [-1]
        assert len(session.source_polarizer) == 0
        assert np.isnan(session.frames["source_angle_rad"]).all()
        assert session.frames["flags"].tolist() == [0]
        np.testing.assert_array_equal(session.frame(0), exposure(1).frame.image)
        np.testing.assert_array_equal(session.audio(0), sweeps(3).block.samples)
    assert info(path)["problems"] == []
    recovered = recover(path, path.with_name("again.h5"))
    with open_session(recovered.session) as copy:
        # What is copied is written in the present layout.
        assert (copy.schema, copy.trolley["record"].tolist()) == ("polfuse-session/2", [-1])
