"""A URDF of two joints with a mesh for each link."""

import struct

import numpy as np

URDF = """<robot name="two">
<link name="base"><visual><geometry><mesh filename="package://cell/base.stl"/></geometry></visual></link>
<link name="upper"><visual><origin xyz="0 0 0.1" rpy="0 0 1.5707963267948966"/>
<geometry><mesh filename="upper.obj" scale="0.001 0.001 0.001"/></geometry></visual></link>
<link name="flange"><visual><geometry><mesh filename="{last}"/></geometry></visual></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.4"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="flange"/><origin xyz="0.5 0 0"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="2"/></joint>
</robot>
"""


def stl(corners: list[list[list[float]]]) -> bytes:
    """A binary STL file."""
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *np.ravel(each), 0) for each in corners)
    return bytes(80) + struct.pack("<I", len(corners)) + rows
