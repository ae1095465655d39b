"""Triangles and their materials."""

import numpy as np
import pytest

from processing.raytrace.triangles import Triangles


@pytest.mark.parametrize("material", [0, [0], [0, 0]])
def test_materials_are_of_one_type_however_they_are_given(material: object) -> None:
    # Read-only arrays are another type to the compiler: every kernel would be compiled once more.
    mesh = Triangles(
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]), [[0, 1, 2], [1, 3, 2]], np.array(material)
    )
    again = mesh.moved((0.0, 0.0, 1.0))
    assert mesh.material.flags.writeable
    assert again.material.flags.writeable
    assert mesh.material is not again.material
