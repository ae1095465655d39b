"""PolFuse Lab: rail polarimetric SAR and a polarization camera on one scene, from the devices to a fused picture.

The whole chain in a few lines (each name is imported when it is first used)::

    import polfuse_lab as pf

    pf.focus("session.h5", "products.h5")
    pf.calibrate("products.h5", pf.TargetSpec("trihedral", x_m=1.2, y_m=8.6, edge_m=0.61))
    pf.optics("session.h5", "products.h5")
    pf.fuse("products.h5")
    pf.write_report("products.h5", "report.html")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from polfuse_lab.engine import collect
    from polfuse_lab.errors import PolfuseError
    from polfuse_lab.plans import load_plan
    from polfuse_lab.products.analysis import analyse
    from polfuse_lab.products.calibrate import calibrate
    from polfuse_lab.products.calibration_inputs import TargetSpec
    from polfuse_lab.products.focus import focus
    from polfuse_lab.products.fuse import fuse
    from polfuse_lab.products.optics import optics
    from polfuse_lab.products.ranging import range_profiles
    from polfuse_lab.products.store import Products
    from polfuse_lab.replay import replay as replay_session
    from polfuse_lab.report.builder import report as write_report
    from polfuse_lab.rig import load_rig
    from polfuse_lab.session import open_session

__version__ = "0.1.0"

__all__ = [
    "PolfuseError",
    "Products",
    "TargetSpec",
    "analyse",
    "calibrate",
    "collect",
    "focus",
    "fuse",
    "load_plan",
    "load_rig",
    "open_session",
    "optics",
    "range_profiles",
    "replay_session",
    "write_report",
]

_HOMES = {
    "PolfuseError": ("polfuse_lab.errors", "PolfuseError"),
    "Products": ("polfuse_lab.products.store", "Products"),
    "TargetSpec": ("polfuse_lab.products.calibration_inputs", "TargetSpec"),
    "analyse": ("polfuse_lab.products.analysis", "analyse"),
    "calibrate": ("polfuse_lab.products.calibrate", "calibrate"),
    "collect": ("polfuse_lab.engine", "collect"),
    "focus": ("polfuse_lab.products.focus", "focus"),
    "fuse": ("polfuse_lab.products.fuse", "fuse"),
    "load_plan": ("polfuse_lab.plans", "load_plan"),
    "load_rig": ("polfuse_lab.rig", "load_rig"),
    "open_session": ("polfuse_lab.session", "open_session"),
    "optics": ("polfuse_lab.products.optics", "optics"),
    "range_profiles": ("polfuse_lab.products.ranging", "range_profiles"),
    "replay_session": ("polfuse_lab.replay", "replay"),
    "write_report": ("polfuse_lab.report.builder", "report"),
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that importing the package stays fast."""
    import importlib

    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _HOMES[name]
    found = getattr(importlib.import_module(module), attribute)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """Public names, for completion."""
    return sorted([*globals(), *__all__])
