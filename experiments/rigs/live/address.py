"""Addresses of live joints, SCHEME://HOST[:PORT][?OPTION=VALUE&…], and the client of each scheme."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from urllib.parse import parse_qsl, urlsplit

from ....model.errors import BadInput, RigFault
from ....model.files.robot_file import Vendor
from ....model.kinematics.pendant import Pendant
from ....model.parsing.reading import did_you_mean
from ...makers.maker import vendor_of
from .at_rest import JointsAtRest
from .fanuc import FanucJoints
from .joint_client import JointsRefused, LiveAddress, LiveJoints
from .kuka import KukaJoints
from .rosbridge import RosJoints
from .ur import UrJoints
from .yaskawa import YaskawaJoints


@dataclass(frozen=True)
class LiveScheme:
    """A protocol: its usual port, whose robots it reads (None: any maker's), and the names of its options."""

    port: int
    vendor: Vendor | None
    options: tuple[str, ...]
    client: type[LiveJoints]


SCHEMES: Mapping[str, LiveScheme] = {
    "ur": LiveScheme(30004, "universal-robots", ("arm", "dashboard"), UrJoints),
    "kuka": LiveScheme(7000, "kuka", ("arm",), KukaJoints),
    "fanuc": LiveScheme(16001, "fanuc", ("group",), FanucJoints),
    "yaskawa": LiveScheme(10040, "yaskawa", ("arm",), YaskawaJoints),
    "ros": LiveScheme(9090, None, ("topic", "joints"), RosJoints),
}


def parse_address(text: str) -> LiveAddress:
    """An address, its options checked; BadInput for any other text."""
    name, _, _ = text.partition("://")
    scheme = SCHEMES.get(name)
    if scheme is None:
        raise BadInput(
            "the scheme of this address is not known",
            found=text[:200],
            allowed=", ".join(f"{each}://HOST" for each in SCHEMES),
            remedy=did_you_mean(name, SCHEMES),
        )
    try:
        parts = urlsplit(text)
        port, options = (
            parts.port,
            dict(parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))),
        )
    except ValueError:
        parts, port, options = urlsplit(f"{name}://"), None, {}
    if not parts.hostname or parts.path not in ("", "/") or parts.fragment or parts.username or port == 0:
        raise BadInput(
            "this is not the address of a controller",
            found=text[:200],
            allowed=f"{name}://HOST, {name}://HOST:PORT, and ?OPTION=VALUE behind it",
        )
    for option in options:
        if option not in scheme.options:
            raise BadInput(
                f"{option} is not an option of {name}://",
                found=text[:200],
                allowed=", ".join(scheme.options),
                remedy=did_you_mean(option, scheme.options),
            )
    return LiveAddress(name, parts.hostname, port or scheme.port, options)


def open_joints(text: str, pendant: Pendant) -> JointsAtRest:
    """The joints of the arm at an address, connected.

    BadInput for what is no address, an arm of another maker, or a controller whose serial number (or model)
    is not the one of `arm=`; RigFault where the controller does not answer or has another arm's joints.
    """
    address = parse_address(text)
    scheme = SCHEMES[address.scheme]
    maker = vendor_of(pendant.robot)
    if None not in (scheme.vendor, maker) and scheme.vendor != maker:
        raise BadInput(
            f"{address.scheme}:// reads the joints of robots of another maker",
            found=f"{pendant.robot.name}, of {'another maker' if maker == 'other' else maker}",
            allowed=f"a robot of {scheme.vendor}",
        )
    connect = partial(scheme.client, address, pendant)
    try:
        joints = JointsAtRest(connect, pendant)
    except JointsRefused as refused:
        raise RigFault(refused.why) from None
    expected = address.options.get("arm")
    if expected is not None and joints.identity != expected:
        joints.close()
        raise BadInput(
            "the controller is that of another arm",
            found=f"the controller says {joints.identity or 'nothing'}",
            allowed=f"{expected}, as arm= states",
            remedy="state the address of this arm's controller, or its own serial number",
        )
    return joints
