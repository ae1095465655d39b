"""Complex images as SICD (NGA.STND.0024), one NITF file for each channel, by sarkit.

Rows lead away from the rail, columns against x, so that the normal of both points up and shadows fall downward. Pixels
are those of the products file, brought to base band: times ``exp(-j 4 pi fc (R - R_scp) / c)``, R the distance from
the middle of the aperture, as SICD's model of spatial frequencies around one centre asks for. All channels have the
same phase taken off, so that polarimetry stays as it is. Undefined pixels (outside the fan) are zero.

A rail's scene is as near as the rail is long, so spatial frequencies differ from pixel to pixel. ``ImpRespBW`` is what
the whole image needs, ``ImpRespWid`` the width at the scene's centre. Of pixels that stand closer than that bandwidth
asks for every second or third is written: what lies between follows from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.collect_time import Collect, collect_of
from polfuse_lab.exports.formats import Exported, Request, unwritable
from polfuse_lab.exports.layers import Layer, layer_of
from polfuse_lab.exports.placing import needed, placement_of
from polfuse_lab.exports.wgs84 import Placement
from polfuse_lab.products.provenance import versions
from polfuse_lab.products.store import Products
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.radar.ranging import window_weights

VERSION = "urn:SICD:1.3.0"
"""Read by all current readers."""


@dataclass(frozen=True)
class Scene:
    """What the files of all channels have in common."""

    layer: Layer
    placement: Placement
    collect: Collect
    settings: dict[str, Any]
    """Of stage "focus"."""
    bandwidth: tuple[float, float]
    """Of spatial frequencies along rows and columns, 1 / m."""
    stride: tuple[int, int]
    """Pixels of the products file from one written row or column to the next."""

    @property
    def x_m(self) -> NDArray[np.float64]:
        """Of the written columns."""
        return self.layer.x_m[::-1][:: self.stride[1]]

    @property
    def y_m(self) -> NDArray[np.float64]:
        """Of the written rows."""
        return self.layer.y_m[:: self.stride[0]]

    @property
    def scp(self) -> tuple[int, int]:
        """Row and column of the scene's centre pixel, as SICD counts them."""
        return len(self.y_m) // 2, len(self.x_m) // 2

    @property
    def scp_m(self) -> NDArray[np.float64]:
        """(3,) the scene's centre in the rig's coordinates."""
        row, column = self.scp
        return np.array([self.x_m[column], self.y_m[row], self.layer.z_m])

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency."""
        centre, band = float(self.settings["centre_hz"]), float(self.settings["bandwidth_hz"])
        return centre - band / 2, centre + band / 2

    def band_phase(self) -> NDArray[np.complex128]:
        """(rows, columns) what brings pixels of the products file to base band, in their order there."""
        middle = self.collect.places_m(np.array(self.collect.centre_s))
        x, y = self.layer.x_m[None, :] - middle[0], self.layer.y_m[:, None] - middle[1]
        distance = np.sqrt(x**2 + y**2 + (self.layer.z_m - middle[2]) ** 2)
        reference = np.linalg.norm(self.scp_m - middle)
        wavenumber = 4 * np.pi * float(self.settings["centre_hz"]) / SPEED_OF_LIGHT_M_S
        return np.asarray(np.exp(-1j * wavenumber * (distance - reference)))

    def pixels(self, band: int) -> NDArray[np.complex64]:
        """(rows, columns) of one channel as they are written."""
        values = self.layer.values[band] * self.band_phase()
        kept = np.where(np.isfinite(values), values, 0)[:: self.stride[0], ::-1][:, :: self.stride[1]]
        return np.ascontiguousarray(kept).astype(np.complex64)


def run(request: Request) -> Exported:
    """Write one file for each channel: ``OUTPUT`` with ``_HH`` and so on before its suffix, or as it is for one.

    Raises:
        PolfuseError: stages or channels that are missing, no place on the earth, pixels too large for SICD, sarkit not
            installed, or no room.
    """
    needed("sarkit", "export --to sicd")
    scene = scene_of(request.products, placement_of(request.products, request.rig, for_what="SICD"))
    bands = scene.layer.bands
    chosen = request.channels or bands
    if missing := [name for name in chosen if name not in bands]:
        raise PolfuseError(
            f"has no channel {', '.join(missing)}", where=str(request.products.path), advice=f"choose of {bands}"
        )
    files = []
    for name in chosen:
        path = request.output
        if len(chosen) > 1:
            path = path.with_name(f"{path.stem}_{name}{path.suffix or '.nitf'}")
        files.append(write_sicd(scene, name, path))
    values = {"stride": list(scene.stride), "rows": len(scene.y_m), "cols": len(scene.x_m)}
    note = f"slow time is {scene.collect.told}; pixels were brought to base band"
    if max(scene.stride) > 1:
        note += f" and every {scene.stride[0]}. row and {scene.stride[1]}. column written"
    return Exported(tuple(files), "scattering", values, note)


def scene_of(products: Products, placement: Placement) -> Scene:
    """What is to be written, from stages "ranging", "focus" and, if it is there, "calibration".

    Raises:
        PolfuseError: stages that are missing, an imported image, or a track at one place.
    """
    layer = layer_of(products, "scattering")
    layer.on_the_ground()
    collect, settings = collect_of(products), products.settings("focus")
    needed_k = _needed_bandwidth(layer, collect, settings)
    strides = []
    for step, width, what in zip(layer.step_m[::-1], needed_k, ("y", "x"), strict=True):
        if width * step > 1:
            raise PolfuseError(
                f"has pixels of {step:g} m in {what} where its bandwidth needs {1 / width:.3g} m",
                where=layer.where,
                advice="focus with smaller pixels (--pixel) for SICD",
            )
        # SICD wants 1.1 to 2.2 samples for each unit of bandwidth.
        strides.append(max(int(np.ceil(1 / (width * step) / 2.2)), 1))
    return Scene(layer, placement, collect, settings, needed_k, (strides[0], strides[1]))


def _needed_bandwidth(layer: Layer, collect: Collect, settings: dict[str, Any]) -> tuple[float, float]:
    """Bandwidth along rows (y) and columns (x) that holds the spatial frequencies of every pixel, 1 / m."""
    centre, band = float(settings["centre_hz"]), float(settings["bandwidth_hz"])
    x, y = (part.ravel() for part in np.meshgrid(_few(layer.x_m), _few(layer.y_m)))
    pixels = np.stack([x, y, np.full_like(x, layer.z_m)], axis=-1)
    middle = collect.places_m(np.array(collect.centre_s))
    base = 2 * centre / SPEED_OF_LIGHT_M_S * _directions_to(pixels, middle[None])[:, 0]
    widest = np.zeros(3)
    for frequency in (centre - band / 2, centre + band / 2):
        found = 2 * frequency / SPEED_OF_LIGHT_M_S * _directions_to(pixels, collect.antenna_m) - base[:, None]
        widest = np.maximum(widest, 2 * np.abs(found).max(axis=(0, 1)))
    return float(widest[1]), float(widest[0])


def _few(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(axis[np.unique(np.linspace(0, len(axis) - 1, 9).astype(int))])


def _directions_to(pixels: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(pixels, places, 3) unit vectors from places to pixels."""
    between = pixels[:, None] - places
    return np.asarray(between / np.linalg.norm(between, axis=-1, keepdims=True))


def write_sicd(scene: Scene, channel: str, path: Path) -> Path:
    """One channel's file. Raises PolfuseError for pixels that are too large, or without room."""
    sksicd = needed("sarkit.sicd", "export --to sicd")
    tree = _metadata(scene, channel)
    security = sksicd.NitfSecurityFields(clas="U")
    metadata = sksicd.NitfMetadata(
        xmltree=tree,
        file_header_part=sksicd.NitfFileHeaderPart(ostaid="polfuse", ftitle=f"{channel}", security=security),
        im_subheader_part=sksicd.NitfImSubheaderPart(isorce="rail radar", security=security),
        de_subheader_part=sksicd.NitfDeSubheaderPart(security=security),
    )
    fresh = path.with_name(f"{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with fresh.open("wb") as stream, sksicd.NitfWriter(stream, metadata) as writer:
            writer.write_image(scene.pixels(scene.layer.bands.index(channel)))
        fresh.replace(path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        fresh.unlink(missing_ok=True)
    return path


def _metadata(scene: Scene, channel: str) -> Any:
    etree, sksicd = needed("lxml.etree", "export --to sicd"), needed("sarkit.sicd", "export --to sicd")
    root = etree.Element(f"{{{VERSION}}}SICD", nsmap={None: VERSION})
    tree = root.getroottree()
    sicd = sksicd.ElementWrapper(root)
    layer, collect, where = scene.layer, scene.collect, scene.placement
    rows, columns = len(scene.y_m), len(scene.x_m)
    low, high = scene.band_hz
    polarization = f"{channel[0]}:{channel[1]}"

    sicd["CollectionInfo"] = {
        "CollectorName": "rail radar",
        "CoreName": Path(layer.where).stem,
        "CollectType": "MONOSTATIC",
        "RadarMode": {"ModeType": "SPOTLIGHT"},
        "Classification": "UNCLASSIFIED",
    }
    sicd["ImageCreation"] = {"Application": f"polfuse-lab {versions().get('polfuse-lab', '')}".strip()}
    sicd["ImageData"] = {
        "PixelType": "RE32F_IM32F",
        "NumRows": rows,
        "NumCols": columns,
        "FirstRow": 0,
        "FirstCol": 0,
        "FullImage": {"NumRows": rows, "NumCols": columns},
        "SCPPixel": scene.scp,
    }
    corners = [(r, c) for r, c in ((0, 0), (0, columns - 1), (rows - 1, columns - 1), (rows - 1, 0))]
    places = [(scene.x_m[c], scene.y_m[r], layer.z_m) for r, c in corners]
    sicd["GeoData"] = {
        "EarthModel": "WGS_84",
        "SCP": {"ECF": where.ecef(scene.scp_m), "LLH": where.geodetic(scene.scp_m)},
        "ImageCorners": where.geodetic(np.array(places))[:, :2],
    }
    sicd["Grid"] = {
        "ImagePlane": "GROUND",
        "Type": "PLANE",
        "TimeCOAPoly": [[collect.centre_s]],
        **_directions(scene),
    }
    sicd["Timeline"] = {"CollectStart": collect.start, "CollectDuration": collect.duration_s}
    sicd["Position"] = {"ARPPoly": collect.ecef_polynomial(where)}
    sicd["RadarCollection"]["TxFrequency"] = {"Min": low, "Max": high}
    sicd["RadarCollection"]["TxPolarization"] = channel[0]
    channels = sicd["RadarCollection"]["RcvChannels"]
    channels["@size"] = 1
    channels.add("ChanParameters", {"@index": 1, "TxRcvPolarization": polarization})
    sicd["ImageFormation"] = {
        "RcvChanProc": {"NumChanProc": 1, "ChanIndex": [1]},
        "TxRcvPolarizationProc": polarization,
        "TStartProc": 0.0,
        "TEndProc": collect.duration_s,
        "TxFrequencyProc": {"MinProc": low, "MaxProc": high},
        "ImageFormAlgo": "RMA" if scene.settings["method"] == "rma" else "OTHER",
        "STBeamComp": "NO",
        "ImageBeamComp": "SV" if scene.settings.get("beamwidth_rad") else "NO",
        "AzAutofocus": "GLOBAL" if (scene.settings.get("autofocus") or {}).get("applied") else "NO",
        "RgAutofocus": "NO",
    }
    root.append(sksicd.compute_scp_coa(tree))
    return tree


def _directions(scene: Scene) -> dict[str, Any]:
    """Grid/Row and Grid/Col."""
    collect, settings = scene.collect, scene.settings
    low, high = scene.band_hz
    middle = collect.places_m(np.array(collect.centre_s))
    ahead = _directions_to(scene.scp_m[None], middle[None])[0, 0]
    seen = _directions_to(scene.scp_m[None], collect.antenna_m)[0]
    # At the scene's centre: the ramp's band as it is seen on the ground, and the angle that the aperture fills.
    at_centre = (
        2 * (high - low) / SPEED_OF_LIGHT_M_S * ahead[1],
        (low + high) / SPEED_OF_LIGHT_M_S * float(np.ptp(seen[:, 0])),
    )
    windows = str(settings["window"]), str(settings["aperture_window"])
    made = {}
    for n, name in enumerate(("Row", "Col")):
        width = scene.bandwidth[n]
        made[name] = {
            "UVectECF": scene.placement.axes[1] if name == "Row" else -scene.placement.axes[0],
            "SS": scene.layer.step_m[1 - n] * scene.stride[n],
            "ImpRespWid": _width(windows[n]) / at_centre[n],
            "Sgn": -1,
            "ImpRespBW": width,
            "KCtr": (low + high) / SPEED_OF_LIGHT_M_S * ahead[1] if name == "Row" else 0.0,
            "DeltaK1": -width / 2,
            "DeltaK2": width / 2,
        }
    return made


def _width(window: str) -> float:
    """-3 dB width of a window's response, in units of 1 / bandwidth."""
    place = (np.arange(2048) + 0.5) / 2048 - 0.5
    shape = window_weights(window, place, 1e9)

    def level(lag: float) -> float:
        return float(np.sum(shape * np.cos(2 * np.pi * lag * place)) / shape.sum() - np.sqrt(0.5))

    return 2 * float(brentq(level, 0.0, 1.0))
