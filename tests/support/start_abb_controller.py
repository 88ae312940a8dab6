"""A simulated ABB IRC5 to rehearse with (docs/abb.md): Robot Web Services, EGM, sensors. Ctrl-C ends it."""

import argparse
import signal
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path

from abb_controller.egm_server import PacketFaults
from abb_controller.sensor_server import CellSensors
from abb_controller.service import LOOPBACK, SimulatedController, own_plan
from amplifier_stand_in import AmplifierStandIn

from zerobeam.experiments.rigs.simulated.cell_file import CellFile, read_cell
from zerobeam.experiments.sensors.sensors_file import read_calibration
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import read_plan

say = partial(print, flush=True)


def parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(description=__doc__)
    result.add_argument("plan", nargs="?", type=Path, help="plan file (default: an IRB1600 and one PSD)")
    result.add_argument("--cell", type=Path, help="cell file")
    for name, port in (("port", 8080), ("egm-port", 6510), ("sensor-port", 6520)):
        result.add_argument(f"--{name}", type=int, default=port, help="0: any that is free")
    result.add_argument("--bind", default=LOOPBACK, help="address to listen at")
    result.add_argument("--client", default=LOOPBACK, help="address of the client that EGM goes to")
    for share in ("lost", "late", "duplicated", "reordered"):
        result.add_argument(f"--{share}", type=float, default=0.0, help="share of EGM packets")
    result.add_argument("--amplifier", type=Path, help="PSD calibration file: the PSDs are at serial ports")
    result.add_argument("--seed", type=int, default=0)
    return result


def serve(stated: argparse.Namespace) -> None:
    """The controller until SIGINT or SIGTERM; BadInput where a file or a port cannot be used."""
    plan = own_plan() if stated.plan is None else read_plan(stated.plan)
    cell = CellFile() if stated.cell is None else read_cell(stated.cell)
    faults = PacketFaults(stated.lost, stated.late, stated.duplicated, stated.reordered)
    ports = {"port": stated.port, "egm_port": stated.egm_port, "sensor_port": stated.sensor_port}
    addresses = {"bind": stated.bind, "client": stated.client}
    made = SimulatedController(plan, cell, stated.seed, packet_faults=faults, **ports, **addresses)
    with ExitStack() as opened:
        controller = opened.enter_context(made)
        devices = {}
        if stated.amplifier is not None:
            devices = stand_ins(opened, CellSensors(controller.irc5), stated.amplifier)
        say(f"Robot Web Services: {controller.url}")
        say(f"EGM: to {stated.client}, port {controller.egm_port}")
        say(f"PSD and camera: {stated.bind}, port {controller.sensor_port}")
        for target, device in devices.items():
            say(f"PSD amplifier of {target}: {device}")
        say("Ctrl-C ends it.")
        threading.Event().wait()


def stand_ins(opened: ExitStack, sensors: CellSensors, calibration: Path) -> dict[str, str]:
    """By target: the serial port at which an amplifier of this calibration sends what its PSD reads."""
    calibrated = read_calibration(calibration)

    def counts(target: str) -> Callable[[int], Matrix]:
        kind = sensors.psds[target].kind
        return lambda samples: calibrated.counts(sensors.currents(target, samples), kind)

    return {
        target: opened.enter_context(AmplifierStandIn(calibrated.amplifier, counts(target))).device
        for target in sensors.psds
    }


if __name__ == "__main__":
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, signal.default_int_handler)
    with suppress(KeyboardInterrupt):
        serve(parser().parse_args())
