"""A small session along a rail with what makes focusing uneven: missing records in two channels, one at the edge."""

import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "sar"))

from rail_data import HEIGHT_M
from rail_session import write_session

from drivers.records import Channel

TARGETS = [
    ((1.2, 8.0, -HEIGHT_M), np.array([[1, 0.5], [0.3, 0.8j]]) * 3),
    ((-2.0, 13.0, -HEIGHT_M), np.array([[1, 0.5], [0.25, -1]]) * 4),
]
POSITIONS = (np.arange(13) - 6) * 0.0508
GRID = {"x_m": (-4.0, 4.0), "y_m": (5.0, 17.0), "step_m": (0.1, 0.2)}


def uneven_session(path):
    """Four channels, 13 positions; HV misses one, HH the first."""
    return write_session(path, TARGETS, POSITIONS, skip=((Channel.HV, 3), (Channel.HH, 0)))
