"""A GigE Vision camera in pure Python: control and stream on real UDP sockets, frames of the simulated scene."""

from hw_mocks.gige_camera.bootstrap import GVCP_PORT
from hw_mocks.gige_camera.device import GigeCamera
from hw_mocks.gige_camera.pixel_packing import PixelFormat
from hw_mocks.gige_camera.render import SONY_MOSAIC, Exposure, FrameSource, Pattern, SceneView
from hw_mocks.gige_camera.sender import Link
from hw_mocks.gige_camera.settings import Optics, Settings

__all__ = [
    "GVCP_PORT",
    "SONY_MOSAIC",
    "Exposure",
    "FrameSource",
    "GigeCamera",
    "Link",
    "Optics",
    "Pattern",
    "PixelFormat",
    "SceneView",
    "Settings",
]
