"""The camera's GenICam description, made from its table of features."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from xml.sax.saxutils import escape, quoteattr

from hw_mocks.gige_camera.features import BASE, CHUNKS, Feature

_HEAD = (
    '<?xml version="1.0" encoding="utf-8"?>\n'
    '<RegisterDescription ModelName={model} VendorName={vendor} ToolTip="Simulated camera" StandardNameSpace="GEV"'
    ' SchemaMajorVersion="1" SchemaMinorVersion="1" SchemaSubMinorVersion="0"'
    ' MajorVersion="1" MinorVersion="0" SubMinorVersion="0"'
    ' ProductGuid="6e0f1c5a-52c4-4f0b-9a53-70a1d5c1f001" VersionGuid="6e0f1c5a-52c4-4f0b-9a53-70a1d5c1f002"'
    ' xmlns="http://www.genicam.org/GenApi/Version_1_1" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
    ' xsi:schemaLocation="http://www.genicam.org/GenApi/Version_1_1'
    ' http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd">\n'
)
_OUTER = {"integer": "Integer", "float": "Float", "boolean": "Boolean", "enumeration": "Enumeration"}


def describe(features: Sequence[Feature], vendor: str, model: str) -> bytes:
    """The description, UTF-8."""
    groups = list(dict.fromkeys(feature.category for feature in features))
    nodes = [_category("Root", groups)]
    nodes += [_category(group, [f.name for f in features if f.category == group]) for group in groups]
    for feature in features:
        nodes += _nodes(feature)
    nodes.append('<Port Name="Device" NameSpace="Standard"><ToolTip>The camera</ToolTip></Port>')
    nodes += [
        f'<Port Name="{name}Chunk" NameSpace="Custom"><ChunkID>{number:04X}</ChunkID></Port>'
        for name, number in CHUNKS.items()
        if any(feature.chunk == name for feature in features)
    ]
    head = _HEAD.format(model=quoteattr(model), vendor=quoteattr(vendor))
    return (head + "\n".join(nodes) + "\n</RegisterDescription>\n").encode()


def zipped(description: bytes, name: str) -> bytes:
    """The description as the only file of a zip archive, always the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(name, (2000, 1, 1, 0, 0, 0)), description, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def _category(name: str, members: Sequence[str]) -> str:
    inner = "".join(f"<pFeature>{member}</pFeature>" for member in members)
    return f'<Category Name="{name}" NameSpace="Standard">{inner}</Category>'


def _nodes(feature: Feature) -> list[str]:
    name = feature.name
    tip = f"<ToolTip>{escape(feature.tip)}</ToolTip><DisplayName>{name}</DisplayName>"
    if feature.kind == "string":
        return [f'<StringReg Name="{name}" NameSpace="Standard">{tip}{_register(feature)}</StringReg>']
    value = f"<pValue>{name}Reg</pValue>"
    if feature.kind == "command":
        inner = f"{value}<CommandValue>{feature.command_value}</CommandValue>"
        return [f'<Command Name="{name}" NameSpace="Standard">{tip}{inner}</Command>', _raw(feature)]
    tip += "<pIsLocked>TLParamsLocked</pIsLocked>" if feature.frozen else ""
    extra: list[str] = []
    outer = _OUTER[feature.kind]
    if feature.kind == "boolean":
        inner = f"{value}<OnValue>1</OnValue><OffValue>0</OffValue>"
    elif feature.kind == "enumeration":
        entries = "".join(
            f'<EnumEntry Name="{entry}" NameSpace="Standard"><Value>{number}</Value></EnumEntry>'
            for entry, number in feature.symbols.items()
        )
        inner = entries + value
    else:
        limits, extra = _limits(feature)
        unit = f"<Unit>{feature.unit}</Unit>" if feature.unit else ""
        # The schema wants the unit of a Float before, and that of an Integer after its limits' step.
        inner = value + limits + unit
    selects = "<pSelected>ChunkEnable</pSelected>" if name == "ChunkSelector" else ""
    return [f'<{outer} Name="{name}" NameSpace="Standard">{tip}{inner}{selects}</{outer}>', _raw(feature), *extra]


def _limits(feature: Feature) -> tuple[str, list[str]]:
    """Limits of a number that can be written, and the nodes that compute them."""
    if not feature.writable:
        return "", []
    number = float if feature.kind == "float" else int
    low = f"<Min>{number(feature.low)}</Min>"
    step = f"<Inc>{feature.step}</Inc>" if feature.kind == "integer" else ""
    if not isinstance(feature.high, str):
        return f"{low}<Max>{number(feature.high)}</Max>{step}", []
    # Of registers, not of features: a width limited by an offset that is limited by the width is a cycle.
    first, second = (f"{name}Reg" for name in feature.high.split(" - "))
    formula = (
        f'<IntSwissKnife Name="{feature.name}High" NameSpace="Custom"><pVariable Name="A">{first}</pVariable>'
        f'<pVariable Name="B">{second}</pVariable><Formula>A - B</Formula></IntSwissKnife>'
    )
    return f"{low}<pMax>{feature.name}High</pMax>{step}", [formula]


def _register(feature: Feature) -> str:
    address = 0 if feature.chunk else feature.address
    mode = "WO" if feature.kind == "command" else "RW" if feature.writable else "RO"
    port = f"{feature.chunk}Chunk" if feature.chunk else "Device"
    return (
        f"<Address>0x{address:X}</Address><Length>{feature.length}</Length><AccessMode>{mode}</AccessMode>"
        f"<pPort>{port}</pPort><Cachable>NoCache</Cachable>"
    )


def _raw(feature: Feature) -> str:
    """The register node behind a feature."""
    name, inner = f"{feature.name}Reg", _register(feature)
    if feature.kind == "float":
        return f'<FloatReg Name="{name}" NameSpace="Custom">{inner}<Endianess>BigEndian</Endianess></FloatReg>'
    tail = "<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess>"
    if feature.bits is not None:
        # GenApi counts the bits of a big-endian register from its most significant one.
        low, high = feature.bits
        places = f"<LSB>{31 - low}</LSB><MSB>{31 - high}</MSB>"
        return f'<MaskedIntReg Name="{name}" NameSpace="Custom">{inner}{places}{tail}</MaskedIntReg>'
    return f'<IntReg Name="{name}" NameSpace="Custom">{inner}{tail}</IntReg>'


def url(kind: str, address: int, size: int, *, name: str = "polfuse_camera") -> str:
    """Where a client finds the description in the camera's memory (``kind`` ``"zip"`` or ``"xml"``)."""
    return f"Local:{name}.{kind};{address:X};{size:X}"


DESCRIPTION_ADDRESS = 0x200000
"""Where the description starts, far above :data:`~hw_mocks.gige_camera.features.BASE`."""
assert DESCRIPTION_ADDRESS > BASE
