"""PolFuse Lab: rail polarimetric SAR and a polarization camera on one scene, from the devices to a fused picture."""

__version__ = "0.1.0"
