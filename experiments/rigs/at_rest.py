"""Joints that may be recorded: read twice, of an arm at rest, by a controller that is alive, at the address
that is stated.

The arm is at rest where two readings at least `PAUSE_S` apart agree in every joint within `STILL`, or within
two counts of a coarser encoder. The second one must be newer by the controller's own clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeVar
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from ...interruption import obey
from ...model.arrays import Matrix
from ...model.errors import BadInput, RigFault
from ...model.files.robot_file import Vendor
from ...model.kinematics.pendant import Pendant
from ...model.parsing.reading import did_you_mean
from ..makers.maker import vendor_of
from ..procedure.events import MeasurementRecorded, RunEvent
from ..procedure.rig import most, spot_of
from ..procedure.steering import ACCEPTED_MM
from ..sensors.detectors import BRIGHTEST, WEAKEST, Sensors
from .joint_clients import (
    FanucJoints,
    JointReading,
    JointsRefused,
    KukaJoints,
    LiveAddress,
    LiveJoints,
    OtherArm,
    RosJoints,
    UrJoints,
    YaskawaJoints,
)
from .transport import LinkFault

PAUSE_S = 0.25
STILL = 0.002  # deg (mm): below the 0.005 to 0.02 deg that are usual for a joint's noise
_COUNTS = 2
_ATTEMPTS = 3
_LAGS = 0.5  # share of the time that passed by which the controller's clock advances at least
_FARTHEST = 1e5  # deg (mm): a torn number is beyond it

T = TypeVar("T")


class JointsAtRest:
    """The joints of one arm over `connect`, which is called anew after a fault.

    RigFault, also from the constructor, where the controller is not that of the plan's arm.
    """

    def __init__(self, connect: Callable[[], LiveJoints], pendant: Pendant) -> None:
        self._connect, self._pendant = connect, pendant
        self._live: LiveJoints | None = None
        self.identity: str | None = None
        self._attempted(self._connection)

    def take(self) -> Matrix:
        """(n,) deg (mm), joint 3 from link 2; JointsRefused where they may not be recorded."""
        return self._attempted(self._at_rest)

    def moved_from(self, joints: Matrix) -> bool:
        """Whether the arm is elsewhere than at `joints` (n,) deg (mm) now; JointsRefused as `take`."""
        apart = np.abs(self.take() - joints)
        return bool((apart > _tolerance(self._connection())).any())

    def close(self) -> None:
        if self._live is not None:
            self._live.close()
            self._live = None

    def _attempted(self, call: Callable[[], T]) -> T:
        refused = JointsRefused("connection", "")
        for _ in range(_ATTEMPTS):
            obey()
            try:
                return call()
            except LinkFault as fault:
                refused = JointsRefused("connection", f"{fault}: look at the connection, and try again")
            except JointsRefused as error:
                if error.kind == "moving":
                    raise
                refused = error
            except OtherArm as error:
                self.close()
                raise RigFault(f"{error}; nothing of it is recorded") from None
            self.close()
        raise refused

    def _connection(self) -> LiveJoints:
        if self._live is None:
            live = self._connect()
            if self.identity not in (None, live.identity):
                live.close()
                raise OtherArm(f"the controller was {self.identity} and is {live.identity} now")
            self._live, self.identity = live, live.identity
        return self._live

    def _at_rest(self) -> Matrix:
        live = self._connection()
        first, began = self._read(live), time.monotonic()
        time.sleep(PAUSE_S)
        passed = time.monotonic() - began
        second = self._read(live)
        advanced = second.stamp - first.stamp
        if advanced <= 0 or (live.ticks is not None and advanced < _LAGS * passed * live.ticks):
            raise JointsRefused(
                "stale",
                f"the joints are stale: the controller's clock advanced by {_clock(advanced, live)} in"
                f" {passed:.2f} s",
            )
        apart = np.abs(second.joints - first.joints)
        tolerance = _tolerance(live)
        if (apart > tolerance).any():
            joint = int(np.argmax(apart / tolerance))
            unit = self._pendant.robot.joints[joint].unit
            raise JointsRefused(
                "moving",
                f"the arm moves: joint {joint + 1} by {apart[joint]:.3g} {unit} in {passed:.2f} s",
            )
        joints = second.joints
        return joints if live.between_links else self._pendant.between_links(joints)

    def _read(self, live: LiveJoints) -> JointReading:
        reading, n = live.read(), self._pendant.robot.n
        if reading.joints.shape != (n,):
            raise OtherArm(
                f"the controller has {reading.joints.size} joints, and {self._pendant.robot.name} has {n}"
            )
        if (
            not np.isfinite([*reading.joints, reading.stamp]).all()
            or np.abs(reading.joints).max() > _FARTHEST
        ):
            raise LinkFault("the controller sends what are no joints")
        return reading


def _tolerance(live: LiveJoints) -> Matrix:
    return np.asarray(np.maximum(STILL, _COUNTS * np.asarray(live.resolution)))


def _clock(advanced: float, live: LiveJoints) -> str:
    return f"{advanced:.3g}" if live.ticks is None else f"{advanced / live.ticks:.3g} s"


SAMPLES = 50
_LEFT_MM = 1.0  # a spot that has been this far off has left the centre
_PAUSE_S = 0.5


class CentredLines:
    """An empty line whenever the spot is on the centre of the PSD `target`; it has to leave the centre after
    a measurement was recorded. `dark` (4,) are the currents with the laser off."""

    confirms, follows = False, True

    def __init__(self, sensors: Sensors, target: str, dark: Matrix) -> None:
        self._sensors, self._target, self._dark = sensors, target, dark
        self._left = True

    def hear(self, event: RunEvent) -> None:
        """Told of every event of the run."""
        if isinstance(event, MeasurementRecorded):
            self._left = False

    def following(self) -> str | None:
        while True:
            obey()
            off = self._off()
            if off > _LEFT_MM:
                self._left = True
            if self._left and off <= ACCEPTED_MM:
                time.sleep(_PAUSE_S)
                if self._off() <= ACCEPTED_MM:
                    return ""

    def _off(self) -> float:
        """mm from the centre; infinite where the light is not the beam's."""
        psd = self._sensors.psds[self._target]
        currents = most(self._sensors.currents(self._target, SAMPLES), SAMPLES)
        if currents is None or psd.saturated(currents).any():
            return np.inf
        spot = spot_of(psd, currents - self._dark)
        return float(np.linalg.norm(spot.position)) if WEAKEST <= spot.light <= BRIGHTEST else np.inf


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
