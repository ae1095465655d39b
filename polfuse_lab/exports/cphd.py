"""Range profiles as compensated phase history, CPHD (NGA.STND.0068), by sarkit.

Samples are those that CPHD's signal model asks for, over frequency: ``W(f) exp(-j 2 pi f (t - t_srp))`` of an echo
with delay t, W the window over the ramp that the products file was made with; SGN is -1. The scene's centre is the
stabilization reference point of all vectors. Positions are held while they are measured, so transmitter and receiver
stand where the antennas stood; slow time is that of :mod:`polfuse_lab.exports.collect_time`. Amplitudes fall with range
again where the products file had made up for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.collect_time import Collect, collect_of
from polfuse_lab.exports.formats import Exported, Request, unwritable
from polfuse_lab.exports.placing import needed, placement_of
from polfuse_lab.exports.wgs84 import Placement
from polfuse_lab.products.provenance import versions
from polfuse_lab.products.store import Products
from processing.radar.profiles import SPEED_OF_LIGHT_M_S

VERSION = "http://api.nsgreg.nga.mil/schema/cphd/1.1.0"
PARAMETERS = (
    ("TxTime", 1), ("TxPos", 3), ("TxVel", 3), ("RcvTime", 1), ("RcvPos", 3), ("RcvVel", 3), ("SRPPos", 3),
    ("aFDOP", 1), ("aFRR1", 1), ("aFRR2", 1), ("FX1", 1), ("FX2", 1), ("TOA1", 1), ("TOA2", 1), ("TDTropoSRP", 1),
    ("SC0", 1), ("SCSS", 1), ("SIGNAL", 1),
)  # fmt: skip
"""Per-vector parameters and their words of eight bytes, in the order of the file."""
OVERSAMPLING = 1.25
"""Of frequency, over what the swath asks for."""


@dataclass(frozen=True)
class History:
    """Phase history of all channels."""

    channels: tuple[str, ...]
    signal: NDArray[np.complex64]
    """(channels, positions, frequencies); zero where a position was not recorded."""
    recorded: NDArray[np.bool_]
    """(channels, positions)."""
    frequency_hz: NDArray[np.float64]
    """(frequencies,)."""
    srp_m: NDArray[np.float64]
    """(3,) reference point in the rig's coordinates."""
    toa_s: tuple[float, float]
    """First and last echo delay against that of the reference point that all vectors hold."""


def run(request: Request) -> Exported:
    """Write ``OUTPUT`` with all channels, from stages "ranging" and "focus".

    Raises:
        PolfuseError: stages or channels that are missing, no place on the earth, sarkit not installed, or no room.
    """
    needed("sarkit", "export --to cphd")
    placement = placement_of(request.products, request.rig, for_what="CPHD")
    collect = collect_of(request.products)
    history = history_of(request.products, collect, request.channels)
    path = write_cphd(request.products, history, collect, placement, request.output)
    values = {"vectors": history.signal.shape[1], "samples": history.signal.shape[2]}
    window = request.products.settings("ranging").get("window")
    note = f"slow time is {collect.told}; the window over frequency is {window}"
    return Exported((path,), "profiles", values, note)


def history_of(products: Products, collect: Collect, channels: tuple[str, ...] = ()) -> History:
    """Range profiles of stage "ranging" over frequency, against the scene's centre.

    Raises:
        PolfuseError: stages or channels that are missing.
    """
    arrays, settings = products.read("ranging"), products.settings("ranging")
    image, told = products.read("focus"), products.settings("focus")
    names = tuple(str(name) for name in settings["channels"])
    chosen = channels or names
    if missing := [name for name in chosen if name not in names]:
        raise PolfuseError(
            f"has no channel {', '.join(missing)}", where=str(products.path), advice=f"choose of {', '.join(names)}"
        )
    range_m = np.asarray(arrays["range_m"], dtype=np.float64)
    profiles = arrays["profiles"][[names.index(name) for name in chosen]].astype(np.complex128)
    recorded = np.asarray(np.isfinite(profiles).all(axis=2))
    profiles[~recorded] = 0
    if settings.get("range_compensated", True):
        with np.errstate(divide="ignore"):
            profiles *= np.where(range_m > 0, 1 / range_m**2, 0.0)
    centre, band = float(settings["centre_hz"]), float(settings["bandwidth_hz"])
    step = float(range_m[1] - range_m[0])
    # Samples closer in frequency than the swath asks for, as readers expect them.
    count = int(np.ceil(OVERSAMPLING * len(range_m)))
    spacing = SPEED_OF_LIGHT_M_S / (2 * count * step)
    lines = np.arange(-int(band / 2 / spacing), int(band / 2 / spacing) + 1)
    # An echo whose envelope's peak is 1 has the mean 1 over the band.
    spectrum = np.fft.fft(profiles, count, axis=2)[..., lines] * (2 * band * step / SPEED_OF_LIGHT_M_S)
    middle = len(image["y_m"]) // 2, len(image["x_m"]) // 2
    srp = np.array([image["x_m"][middle[1]], image["y_m"][middle[0]], float(told["z_m"])])
    pairs = told.get("antennas_m")
    signal = np.empty(spectrum.shape, dtype=np.complex64)
    frequency = np.asarray(centre + lines * spacing, dtype=np.float64)
    nearest, furthest = np.inf, 0.0
    for number, name in enumerate(chosen):
        sent, received = _antennas(collect, pairs, names.index(name))
        distance = (np.linalg.norm(sent - srp, axis=1) + np.linalg.norm(received - srp, axis=1)) / 2
        nearest, furthest = min(nearest, float(distance.min())), max(furthest, float(distance.max()))
        turns = 2 * frequency * distance[:, None] - 2 * (frequency - centre) * range_m[0]
        signal[number] = spectrum[number] * np.exp(2j * np.pi / SPEED_OF_LIGHT_M_S * turns)
    toa = 2 * (range_m[0] - nearest) / SPEED_OF_LIGHT_M_S, 2 * (range_m[-1] - furthest) / SPEED_OF_LIGHT_M_S
    return History(chosen, signal, recorded, frequency, srp, toa)


def write_cphd(products: Products, history: History, collect: Collect, placement: Placement, path: Path) -> Path:
    """The file of :func:`run`. Raises PolfuseError without room."""
    skcphd = needed("sarkit.cphd", "export --to cphd")
    pairs = products.settings("focus").get("antennas_m")
    names = [str(name) for name in products.settings("ranging")["channels"]]
    tree = _metadata(products, history, collect, placement)
    vectors = [
        _vectors(skcphd, tree, history, collect, placement, number, _antennas(collect, pairs, names.index(name)))
        for number, name in enumerate(history.channels)
    ]
    reference = next(int(np.flatnonzero(recorded)[len(np.flatnonzero(recorded)) // 2]) for recorded in history.recorded)
    tree.getroot().find("{*}Channel/{*}Parameters/{*}RefVectorIndex").text = str(reference)
    geometry = skcphd.compute_reference_geometry(tree, vectors[0])
    tree.getroot().find("{*}Dwell").addnext(geometry)
    fresh = path.with_name(f"{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with fresh.open("wb") as stream, skcphd.Writer(stream, skcphd.Metadata(xmltree=tree)) as writer:
            for number, name in enumerate(history.channels):
                writer.write_signal(name, history.signal[number])
                writer.write_pvp(name, vectors[number])
        fresh.replace(path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        fresh.unlink(missing_ok=True)
    return path


def _antennas(
    collect: Collect, pairs: list[dict[str, list[float]]] | None, channel: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places (positions, 3) of the sending and the receiving antenna of a channel, in the rig's coordinates."""
    if pairs is None:
        return collect.antenna_m, collect.antenna_m
    return collect.antenna_m + pairs[channel]["transmit"], collect.antenna_m + pairs[channel]["receive"]


def _vectors(
    skcphd: Any,
    tree: Any,
    history: History,
    collect: Collect,
    placement: Placement,
    number: int,
    antennas: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> NDArray[Any]:
    made = np.zeros(history.signal.shape[1], dtype=skcphd.get_pvp_dtype(tree))
    sent, received = (placement.ecef(places) for places in antennas)
    srp = placement.ecef(history.srp_m)
    velocity = collect.velocities_m_s(collect.times_s) @ placement.axes
    away = [places - srp for places in (sent, received)]
    distances = [np.linalg.norm(part, axis=1) for part in away]
    made["TxTime"] = collect.times_s
    made["RcvTime"] = collect.times_s + sum(distances) / SPEED_OF_LIGHT_M_S
    made["TxPos"], made["RcvPos"], made["SRPPos"] = sent, received, srp
    made["TxVel"] = made["RcvVel"] = velocity
    speed = sum(np.sum(velocity * part, axis=1) / distance for part, distance in zip(away, distances, strict=True))
    made["aFDOP"] = -speed / SPEED_OF_LIGHT_M_S
    made["FX1"], made["FX2"] = history.frequency_hz[0], history.frequency_hz[-1]
    made["TOA1"], made["TOA2"] = history.toa_s
    made["SC0"] = history.frequency_hz[0]
    made["SCSS"] = history.frequency_hz[1] - history.frequency_hz[0]
    made["SIGNAL"] = history.recorded[number]
    return made


def _metadata(products: Products, history: History, collect: Collect, placement: Placement) -> Any:
    etree, skcphd = needed("lxml.etree", "export --to cphd"), needed("sarkit.cphd", "export --to cphd")
    root = etree.Element(f"{{{VERSION}}}CPHD", nsmap={None: VERSION})
    cphd = skcphd.ElementWrapper(root)
    count, positions, samples = history.signal.shape
    low, high = float(history.frequency_hz[0]), float(history.frequency_hz[-1])
    image = products.read("focus")
    x = np.sort(-(np.asarray(image["x_m"]) - history.srp_m[0]))
    y = np.asarray(image["y_m"]) - history.srp_m[1]
    corners = [(y[0], x[0]), (y[0], x[-1]), (y[-1], x[-1]), (y[-1], x[0])]
    places = [history.srp_m + np.array([-across, along, 0.0]) for along, across in corners]

    cphd["CollectionID"] = {
        "CollectorName": "rail radar",
        "CoreName": products.path.stem,
        "CollectType": "MONOSTATIC",
        "RadarMode": {"ModeType": "SPOTLIGHT"},
        "Classification": "UNCLASSIFIED",
        "ReleaseInfo": "UNRESTRICTED",
    }
    cphd["Global"] = {
        "DomainType": "FX",
        "SGN": -1,
        "Timeline": {
            "CollectionStart": collect.start,
            "TxTime1": float(collect.times_s[0]),
            "TxTime2": float(collect.times_s[-1]),
        },
        "FxBand": {"FxMin": low, "FxMax": high},
        "TOASwath": {"TOAMin": history.toa_s[0], "TOAMax": history.toa_s[1]},
    }
    cphd["SceneCoordinates"] = {
        "EarthModel": "WGS_84",
        "IARP": {"ECF": placement.ecef(history.srp_m), "LLH": placement.geodetic(history.srp_m)},
        "ReferenceSurface": {"Planar": {"uIAX": placement.axes[1], "uIAY": -placement.axes[0]}},
        "ImageArea": {"X1Y1": (y[0], x[0]), "X2Y2": (y[-1], x[-1])},
        "ImageAreaCornerPoints": placement.geodetic(np.array(places))[:, :2],
        "ImageGrid": {
            "IARPLocation": (len(y) // 2, len(x) - 1 - len(x) // 2),
            "IAXExtent": {"LineSpacing": float(np.diff(y).mean()), "FirstLine": 0, "NumLines": len(y)},
            "IAYExtent": {"SampleSpacing": float(np.diff(x).mean()), "FirstSample": 0, "NumSamples": len(x)},
        },
    }
    width = sum(words for _, words in PARAMETERS) * 8
    cphd["Data"] = {"SignalArrayFormat": "CF8", "NumBytesPVP": width, "NumCPHDChannels": count}
    for number, name in enumerate(history.channels):
        cphd["Data"].add(
            "Channel",
            {
                "Identifier": name,
                "NumVectors": positions,
                "NumSamples": samples,
                "SignalArrayByteOffset": number * positions * samples * 8,
                "PVPArrayByteOffset": number * positions * width,
            },
        )
    cphd["Data"]["NumSupportArrays"] = 0
    cphd["Channel"] = {
        "RefChId": history.channels[0],
        "FXFixedCPHD": True,
        "TOAFixedCPHD": True,
        "SRPFixedCPHD": True,
    }
    for number, name in enumerate(history.channels):
        cphd["Channel"].add(
            "Parameters",
            {
                "Identifier": name,
                "RefVectorIndex": positions // 2,
                "FXFixed": True,
                "TOAFixed": True,
                "SRPFixed": True,
                "SignalNormal": bool(history.recorded[number].all()),
                "Polarization": {"TxPol": name[0], "RcvPol": name[1]},
                "FxC": (low + high) / 2,
                "FxBW": high - low,
                "TOASaved": history.toa_s[1] - history.toa_s[0],
                "DwellTimes": {"CODId": "aperture", "DwellId": "aperture"},
            },
        )
    offset = 0
    for name, words in PARAMETERS:
        kind = np.dtype("i8" if name == "SIGNAL" else ("f8", (words,)) if words > 1 else "f8")
        cphd["PVP"][name] = {"Offset": offset, "Size": words, "dtype": kind}
        offset += words
    span = float(collect.times_s[-1] - collect.times_s[0])
    cphd["Dwell"] = {"NumCODTimes": 1, "NumDwellTimes": 1}
    cphd["Dwell"].add("CODTime", {"Identifier": "aperture", "CODTimePoly": [[float(collect.times_s[0]) + span / 2]]})
    cphd["Dwell"].add("DwellTime", {"Identifier": "aperture", "DwellTimePoly": [[span]]})
    cphd["ProductInfo"] = {"Profile": f"polfuse-lab {versions().get('polfuse-lab', '')}".strip()}
    return root.getroottree()
