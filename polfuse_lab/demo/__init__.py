"""The main job on a simulated rig: collect, focus, calibrate, optics, fuse, report, and what came out of it checked.

Everything here works on files and on the scene's truth; the simulated devices are started by whoever calls.
"""
