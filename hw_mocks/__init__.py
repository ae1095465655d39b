"""Devices simulated at the wire, all looking at one scene."""
