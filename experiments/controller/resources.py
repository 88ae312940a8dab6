"""What a client may ask for: the resources of Robot Web Services that the simulated controller has."""

from __future__ import annotations

import re
from dataclasses import dataclass

from .irc5 import DOMAINS, Irc5
from .rapid_data import MODULE, number_text
from .return_code import INVALID_ARGUMENT, NO_SUCH_RESOURCE, NO_SUCH_SIGNAL, NO_SUCH_SYMBOL, RequestRefused

TASK, UNIT = "T_ROB1", "ROB_1"
_SYMBOL = "rw/rapid/symbol/data/RAPID/"
_SIGNAL = "rw/iosystem/signals/"
_DEVICE = "Local/DRV_1/"


@dataclass(frozen=True)
class Asked:
    """`path` has no slash at either end; `action` is that of the URL, `form` what was posted."""

    method: str
    path: str
    action: str
    form: dict[str, str]
    session: str


@dataclass(frozen=True)
class State:
    """An item of an answer."""

    kind: str
    title: str
    values: dict[str, str]


def answer(controller: Irc5, asked: Asked) -> tuple[State, ...] | None:
    """The items of the answer, None where there is nothing to say (204). Raises RequestRefused."""
    if asked.method == "GET":
        return _states_of(controller, asked)
    _do(controller, asked)
    return None


def _states_of(controller: Irc5, asked: Asked) -> tuple[State, ...]:
    path = asked.path
    if path == "ctrl/identity":
        # What distinguishes it from a real one, as for any virtual controller.
        values = {"ctrl-name": "zerobeam", "ctrl-type": "Virtual Controller"}
        return (State("ctrl-identity-info", "identity", values),)
    if path == "rw/panel/ctrlstate":
        return (State("pnl-ctrlstate", "ctrlstate", {"ctrlstate": controller.state}),)
    if path == "rw/panel/opmode":
        return (State("pnl-opmode", "opmode", {"opmode": controller.mode}),)
    if path == "rw/panel/speedratio":
        return (State("pnl-speedratio", "speedratio", {"speedratio": str(controller.speed_ratio)}),)
    if path == f"rw/motionsystem/mechunits/{UNIT}/jointtarget":
        axes = {f"rax_{i}": number_text(v, 7) for i, v in enumerate(controller.joints_deg(), start=1)}
        return (State("ms-jointtarget", UNIT, {**axes, **{f"eax_{letter}": "0" for letter in "abcdef"}}),)
    if path == "rw/rapid/execution":
        values = {"ctrlexecstate": controller.execution, "cycle": controller.cycle_mode}
        return (State("rap-execution", "execution", values),)
    if path == "rw/rapid/tasks":
        values = {
            "name": TASK,
            "type": "norm",
            "taskstate": "linked",
            "excstate": "started" if controller.running else "stopped",
            "active": "On",
            "motiontask": "TRUE",
        }
        return (State("rap-task-li", TASK, values),)
    if path.startswith(_SYMBOL):
        name = _symbol(controller, path)
        return (State("rap-data", f"RAPID/{TASK}/{MODULE}/{name}", {"value": controller.data.text(name)}),)
    if path.startswith(_SIGNAL):
        name = _signal(controller, path)
        values = {"name": name, "type": "DO", "category": "", "lvalue": str(controller.signals[name])}
        return (State("ios-signal", path.removeprefix(_SIGNAL), {**values, "lstate": "not simulated"}),)
    if path == "users/rmmp/poll":
        return (State("user-rmmp-poll", "state", _privilege(controller, asked.session)),)
    domains = _domains(path)
    return tuple(
        State("msh-resource", domain, _mastership(controller, domain, asked.session)) for domain in domains
    )


def _do(controller: Irc5, asked: Asked) -> None:
    path, action, form = asked.path, asked.action, asked.form
    if path == "rw/panel/ctrlstate":
        _require(action == "setctrlstate", action)
        controller.set_state(form.get("ctrl-state", ""))
    elif path == "rw/panel/speedratio":
        _require(action == "setspeedratio", action)
        controller.set_speed_ratio(form.get("speed-ratio", ""))
    elif path == "rw/rapid/execution":
        if action == "start":
            controller.start(form.get("cycle", ""), asked.session)
        elif action == "stop":
            controller.stop()
        else:
            _require(action == "resetpp", action)
            controller.reset_program_pointer(asked.session)
    elif path.startswith(_SYMBOL):
        name = _symbol(controller, path)
        _require(action == "set" and "value" in form, action)
        controller.write(name, form["value"], asked.session)
    elif path.startswith(_SIGNAL):
        name = _signal(controller, path)
        _require(action == "set", action)
        controller.set_signal(name, form.get("lvalue", ""), asked.session)
    elif path == "users/rmmp":
        _require(form.get("privilege") == "modify", "privilege")
        # False: asked for, and the person at the pendant has not said yes.
        controller.remote.setdefault(asked.session, False)
    else:
        domains = _domains(path)
        _require(action in ("request", "release"), action)
        (controller.request if action == "request" else controller.release)(domains, asked.session)


def _require(fine: bool, found: str) -> None:
    if not fine:
        raise RequestRefused(INVALID_ARGUMENT, found[:80])


def _symbol(controller: Irc5, path: str) -> str:
    """RAPID ignores case."""
    parts = path.removeprefix(_SYMBOL).lower().split("/")
    if parts[:-1] != [TASK.lower(), MODULE] or parts[-1] not in controller.data:
        raise RequestRefused(NO_SUCH_SYMBOL)
    return parts[-1]


def _signal(controller: Irc5, path: str) -> str:
    name = path.removeprefix(_SIGNAL).removeprefix(_DEVICE)
    if name not in controller.signals:
        raise RequestRefused(NO_SUCH_SIGNAL)
    return name


def _privilege(controller: Irc5, session: str) -> dict[str, str]:
    if session not in controller.remote:
        return {"code": "-1073445870", "status": "NO SUCH REQUEST"}
    if controller.remote[session]:
        return {"code": "294915", "status": "GRANTED"}
    return {"code": "294914", "status": "PENDING"}


def _domains(path: str) -> tuple[str, ...]:
    """The domains of mastership that a path names: one, or all."""
    found = re.fullmatch(r"rw/mastership(?:/(\w+))?", path)
    if found is None or (found[1] is not None and found[1] not in DOMAINS):
        raise RequestRefused(NO_SUCH_RESOURCE)
    return DOMAINS if found[1] is None else (found[1],)


def _mastership(controller: Irc5, domain: str, session: str) -> dict[str, str]:
    holder = controller.masters.get(domain)
    return {
        "uid": "0" if holder is None else holder.split(":", 1)[0],
        "application": "" if holder is None else "RobAPI2-Client",
        "mastership": "nomaster" if holder is None else "remote",
        "mastershipheldbyme": "TRUE" if holder == session else "FALSE",
    }
