"""Simulated polarization pictures: scene files, meshes from OBJ and PLY, products and figures of the ray tracer."""
