"""The report's pictures with their captions, drawn from the stages present."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from polfuse_lab.products.store import Products

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """One figure of the page."""

    name: str
    """For a file name."""
    title: str
    caption: str
    png: bytes

    @property
    def data_uri(self) -> str:
        """The picture as text, so that the page needs no other file."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode("ascii")


def stage_pictures(products: Products, stage: str | None = None) -> list[Picture]:
    """The pictures of one stage, or of all that are there, from radar and camera to their fusion."""
    chosen = products.stages() if stage is None else [stage]
    return [picture for name, draw in _PICTURES.items() if name in chosen for picture in draw(products)]


def pictured_stages() -> list[str]:
    """Stages that have pictures, in their order on the page."""
    return list(_PICTURES)


def _picture(name: str, title: str, caption: str, figure: Figure) -> Picture:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", metadata={"Software": None})
    return Picture(name, title, caption, stream.getvalue())


def _channels(products: Products, stage: str) -> tuple[str, ...]:
    return tuple(str(name) for name in products.settings(stage)["channels"])


def _ranging(products: Products) -> list[Picture]:
    from polfuse_lab.products.figures_sar import rail_figure

    caption = (
        "Range profiles at every position along the rail, one panel per channel. A target's range changes along the "
        "rail as a hyperbola; its curvature is what focusing uses."
    )
    figure = rail_figure(products.read("ranging"), _channels(products, "ranging"))
    return [_picture("range", "Range profiles", caption, figure)]


def _focus(products: Products) -> list[Picture]:
    if "calibration" in products.stages():
        # The calibrated picture shows the same in honest units.
        return []
    from polfuse_lab.products.figures_sar import magnitude_figure

    figure = magnitude_figure(products.read("focus"), _channels(products, "focus"))
    return [_picture("focus", "Focused image", "Magnitude of every channel, not calibrated.", figure)]


def _calibration(products: Products) -> list[Picture]:
    from polfuse_lab.products.figures_calibration import noise_figure, rcs_figure

    arrays, settings = products.read("calibration"), products.settings("calibration")
    rcs = (
        f"RCS of every channel (transmit, then receive) after calibration on the {settings['target']['kind']}; rings "
        "mark the calibration target and the check target where their ranges put them on the ground plane."
    )
    noise = "RCS of a target that would be as strong as the noise. White noise after range compensation grows as R⁴."
    return [
        _picture("rcs", "Calibrated RCS", rcs, rcs_figure(arrays, settings)),
        _picture("noise", "Noise-equivalent RCS", noise, noise_figure(arrays, settings)),
    ]


def _analysis(products: Products) -> list[Picture]:
    from polfuse_lab.products.figures_analysis import figures_of

    captions = {
        "analysis": (
            "Target against range",
            "Mean of a strip around the target, in received power and after calibration, as thesis Fig. 5.17 and 5.19; "
            "the dotted line is the target's range, bands are one standard deviation of a repeat.",
        ),
        "matrices": (
            "Scattering matrix of the target's region",
            "Relative to HH, from mean received powers as thesis 5.11 and from complex amplitudes: powers do not tell "
            "a trihedral from a dihedral, whose VV has the opposite sign.",
        ),
        "pattern": (
            "Antenna pattern",
            "Two-way pattern of the co-polarized channels along the rail: the calibration target's echo at each "
            "position over its own response there, and the model with which images are formed.",
        ),
        "sky": ("The sky", "What the radar receives from the clear sky, and what of it is noise (thesis Fig. 5.21)."),
    }
    drawn = figures_of(products.read("analysis"), products.settings("analysis"))
    return [_picture(name, *captions[name], figure) for name, figure in drawn.items()]


def _polarimetry(products: Products) -> list[Picture]:
    from polfuse_lab.products.figures_fusion import lexicographic_figure, pauli_figure

    caption = (
        "Pauli components from complex amplitudes. Red: even bounce (dihedral); green: turned or volume scattering "
        "(bush); blue: odd bounce (plate, trihedral)."
    )
    plain = (
        "Lexicographic components, calibrated and with the mean of HV and VH. Red: HH; green: √2 HV; blue: VV. Purple: "
        "HH and VV are equally strong, whatever their phases."
    )
    arrays = products.read("polarimetry")
    return [
        _picture("pauli", "Scattering mechanisms", caption, pauli_figure(arrays)),
        _picture("lexicographic", "Polarization channels", plain, lexicographic_figure(arrays)),
    ]


def _optics(products: Products) -> list[Picture]:
    from polfuse_lab.products.figures_optics import composite_figure, optics_figure
    from polfuse_lab.products.optics import UNITS, series_of
    from processing.optics.stokes import StokesImage

    arrays = products.read("optics")
    image = StokesImage(**{name: arrays[name] for name in UNITS})
    caption = (
        "Stokes parameters of the polarizer series in the camera's frame, the degree of linear polarization without "
        "its noise bias, the angle of polarization from horizontal, and why pixels are masked."
    )
    figure = optics_figure(image, series_of(products.settings("optics")))
    colours = (
        "Stokes parameters as colours (thesis 7.7): unpolarized light is green, yellow has much of S1, cyan much of S2."
    )
    return [
        _picture("optics", "Polarization of the light", caption, figure),
        _picture("stokes", "Stokes parameters as colours", colours, composite_figure(image)),
    ]


def _active_optics(products: Products) -> list[Picture]:
    from polfuse_lab.products.figures_optics_active import active_figure
    from polfuse_lab.products.optics_active import image_of

    caption = (
        "Active mode in visible light (thesis 6.3): intensities by the polarizers of source and camera, their Pauli "
        "composite (of received powers, not of complex amplitudes; square-root scale), and the degree of polarization "
        "of thesis 6.8."
    )
    return [_picture("active_optics", "Active mode", caption, active_figure(image_of(products)))]


def _fusion(products: Products) -> list[Picture]:
    from polfuse_lab.products.figures_fusion import both_figure, class_figure, fused_figure
    from polfuse_lab.products.fused_colours import fused_colours_figure
    from polfuse_lab.products.pauli_space import load_space, space_figure

    arrays, settings = products.read("fusion"), products.settings("fusion")
    fused = (
        "The fused vector of thesis 6.12 on the ground: three normalised Pauli components from the radar and the "
        "degree of linear polarization from the camera. Grey where one of the two sees nothing above its noise."
    )
    classes = (
        f"Classes of the fused vector ({settings.get('classifier', 'kmeans')}), and where they lie between two of its "
        "components."
    )
    colours = (
        "The mechanism that the radar tells as hue, the camera's degree of linear polarization as saturation, and its "
        "S0 as brightness, on the ground."
    )
    space = (
        "The same classes by their Pauli components, and with the degree of linear polarization upwards (thesis Figs. "
        "7.21, 7.22); some points of each."
    )
    title = "Radar in the camera's picture"
    overlay = "The radar's Pauli composite laid over the camera's picture, with lines of equal ground range."
    if settings.get("registration") == "identity":
        title = "Radar and camera on the ground"
        overlay = "The radar's Pauli composite laid over the camera's picture; both were simulated on this grid."
    return [
        _picture("fusion", "Fused vector", fused, fused_figure(arrays, list(settings["features"]))),
        _picture("fused-colours", "Radar and camera in one colour", colours, fused_colours_figure(arrays)),
        _picture("classes", "Classes", classes, class_figure(arrays, settings)),
        _picture("pauli-space", "Classes in the space of Pauli components", space, space_figure(load_space(products))),
        _picture("overlay", title, overlay, both_figure(products)),
    ]


_PICTURES: dict[str, Callable[[Products], list[Picture]]] = {
    "ranging": _ranging,
    "focus": _focus,
    "calibration": _calibration,
    "analysis": _analysis,
    "polarimetry": _polarimetry,
    "optics": _optics,
    "active_optics": _active_optics,
    "fusion": _fusion,
}
