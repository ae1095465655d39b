"""Feature aliases and limits, on a node map of our own that behaves like GenApi's."""

import pytest
from camera_node_map import READ_ONLY, Node, NodeMap

from drivers.camera.features import EXPOSURE, GAIN, Features


@pytest.mark.parametrize("name", EXPOSURE)
def test_exposure_is_found_under_each_of_its_names(name: str) -> None:
    node_map = NodeMap({name: Node(100.0, 10.0, 1e6)})
    features = Features(node_map)
    assert features.put(EXPOSURE, 2000.0)
    assert node_map.nodes[name].value == 2000.0
    assert features.value(EXPOSURE) == 2000.0
    assert features.missing == []


def test_the_first_name_wins() -> None:
    node_map = NodeMap({"ExposureTimeAbs": Node(1.0, 0.0, 9.0), "ExposureTime": Node(2.0, 0.0, 9.0)})
    assert Features(node_map).value(EXPOSURE) == 2.0


def test_what_the_camera_lacks_is_remembered_once_asked_for() -> None:
    features = Features(NodeMap())
    assert not features.put(EXPOSURE, 1.0)
    assert not features.put("ExposureAuto", "Off", needed=False)
    assert not features.execute("TriggerSoftware")
    assert features.value(GAIN) is None
    assert features.symbols("PixelFormat") == ()
    assert features.missing == ["ExposureTime"]


def test_a_locked_feature_is_missing_unless_it_stands_as_wanted() -> None:
    node_map = NodeMap({"Gain": Node(0.0, 0.0, 20.0, mode=READ_ONLY)})
    features = Features(node_map)
    assert features.put(GAIN, 0.0)
    assert features.missing == []
    assert not features.put(GAIN, 3.0)
    assert features.missing == ["Gain"]
    assert node_map.nodes["Gain"].value == 0.0


def test_values_outside_the_limits_are_refused_with_the_limits() -> None:
    features = Features(NodeMap({"ExposureTime": Node(100.0, 10.0, 1000.0)}))
    with pytest.raises(ValueError, match=r"ExposureTime: found 2000.0, allowed: 10.0 to 1000.0"):
        features.put(EXPOSURE, 2000.0)
    features = Features(NodeMap({"PixelFormat": Node("Mono8", symbolics=("Mono8", "Mono12"))}))
    with pytest.raises(ValueError, match="found 'Mono16', allowed: Mono8, Mono12"):
        features.put("PixelFormat", "Mono16")


def test_whole_numbers_are_rounded_to_the_increment() -> None:
    node_map = NodeMap({"Width": Node(640, 16, 1024, inc=8)})
    Features(node_map).put("Width", 782)
    assert node_map.nodes["Width"].value == 784


def test_commands_are_executed() -> None:
    node_map = NodeMap({"TriggerSoftware": Node(None)})
    assert Features(node_map).execute("TriggerSoftware")
    assert node_map.nodes["TriggerSoftware"].executed == 1
