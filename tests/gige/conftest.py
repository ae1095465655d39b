"""A simulated GigE Vision camera on a free port of the loopback interface, and a client of it."""

from collections.abc import Iterator

import pytest
from gige_client import Client

from hw_mocks.faults import FaultScript
from hw_mocks.gige_camera import GigeCamera, Pattern, Settings
from hw_mocks.world import World


@pytest.fixture
def faults() -> FaultScript:
    return FaultScript()


@pytest.fixture
def camera(faults: FaultScript) -> Iterator[GigeCamera]:
    """A small sensor (96 x 64) at 100 frames per second with the pattern that is known pixel by pixel."""
    settings = Settings(frame_rate_hz=100.0, exposure_s=0.001, drift_ppm=40.0)
    with GigeCamera(Pattern(64, 96), World(), port=0, settings=settings, faults=faults) as made:
        yield made
        made.check()


@pytest.fixture
def client(camera: GigeCamera) -> Iterator[Client]:
    with Client(camera) as made:
        yield made
