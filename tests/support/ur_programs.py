"""Random URScript programs of a UR5e, and instructions that have to be refused."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from controller_arm import ControllerArm
from ur_controller import UrController, UrRun, pose_of, values_of

from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import load_robot

TCP = (0.01, -0.02, 0.12, 0.1, -0.2, 0.3)
OTHER_TCP = (0.0, 0.03, 0.1, 0.0, 0.1, 0.0)
HARMLESS = "rq_open"


@cache
def nominal() -> ControllerArm:
    return ControllerArm.of(load_robot("ur5e"))


def listed(values: Matrix) -> str:
    return ", ".join(f"{value:.9f}" for value in values)


@dataclass(frozen=True)
class Script:
    """The parts of a program: `head` before its `body`, both without the indentation."""

    head: tuple[str, ...]
    body: tuple[str, ...]
    rows: Matrix
    literals: int
    tool: str = ""
    left: frozenset[str] = frozenset()
    calls: frozenset[str] = frozenset()
    form: str = ""
    begin: str = "def job():"

    def text(self) -> str:
        lines = [self.begin, *self.head, *self.body, "end"]
        return "\n".join([*lines, "job()", ""])

    @property
    def choices(self) -> ProgramOptions:
        return ProgramOptions(
            tools=[self.tool] if self.tool else [], leave=sorted(self.left), calls=sorted(self.calls)
        )

    def controller(self) -> UrController:
        def other(run: UrRun) -> None:
            run.tcp = pose_of(OTHER_TCP)

        return UrController(nominal(), pose_of(TCP), {HARMLESS: lambda run: None, "foreign": other})


class Writer:
    """A random body. `known`: straight-line code leads here from a motion."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        sign = rng.choice([-1, 1], 3)
        centre = np.array(
            [rng.uniform(-120, 120), -80, 85 * sign[1], rng.uniform(-110, -60), 85 * sign[2], 20]
        )
        self.rows = centre + rng.uniform(-14, 14, (int(rng.integers(3, 7)), 6))
        self.tcp = pose_of(TCP)
        self.used: set[str] = set()
        self.literals = 0
        self.lines: list[str] = []
        self.known = False
        self.count = 0
        self.calls: set[str] = set()

    def pick(self, *options: str) -> str:
        return str(self.rng.choice(list(options)))

    def add(self, *lines: str) -> None:
        self.lines += lines

    def pose(self, k: int) -> str:
        return f"p[{listed(values_of(nominal().fk(self.rows[k], 'deg') @ self.tcp))}]"

    def joints(self, k: int) -> str:
        return f"[{listed(np.radians(self.rows[k]))}]"

    def named(self, kind: str, k: int) -> str:
        self.used.add(f"{kind}{k}")
        return f"W{k}_{kind}"

    def motion(self) -> None:
        k, kind = int(self.rng.integers(len(self.rows))), self.rng.random()
        more = self.pick("", ", a=1.2, v=0.5", ", 1.2, 0.5, 0, 0", ", a=1.4, v=1.05, r=0.01")
        if kind < 0.15:
            self.literals += 1
            self.add(f"movej({self.joints(k)}{more})")
        elif kind < 0.25:
            self.literals += 1
            self.add(f"movej([{', '.join(f'd2r({value:.6f})' for value in self.rows[k])}]{more})")
        elif kind < 0.4 or (not self.known and kind < 0.7 and self.rng.random() < 0.96):
            self.add(f"movej({self.named('q', k)}{more})")
        elif kind < 0.6 or (not self.known and self.rng.random() < 0.96):
            near = self.pick("qnear=", "")
            self.add(f"movej(get_inverse_kin({self.named('p', k)}, {near}{self.named('q', k)}){more})")
        elif kind < 0.68:
            name = self.named("p", k)
            target = name if self.rng.random() < 0.5 else f"get_inverse_kin({name})"
            self.add(f"movej({target}{more})")
        elif kind < 0.8:
            self.literals += 1
            self.add(f"{self.pick('movel', 'movep')}({self.pose(k)}{more})")
        else:
            self.add(f"{self.pick('movel', 'movep')}({self.named('p', k)}{more})")
        self.known = True

    def plain(self) -> None:
        if self.rng.random() < 0.1:
            self.calls.add(HARMLESS)
            self.add(self.pick(f"{HARMLESS}()", f'x = {HARMLESS}(1, "fast")'))
            return
        if self.rng.random() < 0.08:
            self.literals += 1
            self.add("set_target_payload(1.5, [0, 0, 0.1], [0.01, 0.01, 0.01, 0, 0, 0])")
            return
        self.add(
            self.pick(
                "x = x + 1",
                "global y = (x - 3) * 2.5e-1",
                "local flag = not get_standard_digital_in(2)",
                "ready = get_digital_in(1) or x > 2",
                "sleep(0.5)",
                "sync()",
                "set_standard_digital_out(1, True)",
                'textmsg("movel(p[0,0,0,0,0,0]) # ", x)',
                "# movel(p[0, 0, 0, 0, 0, 0])",
                '$ 3 "MoveJ" "breakAfter"',
                "parts = [1, 2, x]",
                "parts[1] = x + 2",
                "set_payload(1.0, [0, 0, 0.05])",
                "set_gravity([0, 0, 9.82])",
                'popup("set_tcp(p[0,0,0,0,0,0])")',
                "y = sqrt(4) + d2r(3)",
                "",
                "write_output_boolean_register(1,\n  True)",
                "enter_critical\nexit_critical",
            )
        )

    def block(self, depth: int) -> None:
        for _ in range(int(self.rng.integers(1, 5))):
            kind = self.rng.random()
            if kind < 0.6:
                self.motion()
            elif kind < 0.8 or depth > 1:
                self.plain()
            else:
                self.structure(depth + 1)

    def structure(self, depth: int) -> None:
        kind = int(self.rng.integers(4))
        condition = self.pick(
            "x > 1", "(get_standard_digital_in(1))", "not get_digital_in(2) and True", "x == 2"
        )
        if kind == 0:
            self.add(f"if {condition}:")
            self.block(depth)
            for word in (f"elif {condition}:", "else:"):
                if self.rng.random() < 0.5:
                    self.add(word)
                    self.known = False
                    self.block(depth)
            self.add("end")
        elif kind == 1:
            self.count += 1
            name = f"n{self.count}"
            self.add(f"{name} = 0", f"while {name} < 2:")
            self.known = False
            self.block(depth)
            self.add(f"{name} = {name} + 1", "end")
        elif kind == 2:
            self.count += 1
            name = f"go{self.count}"
            self.add(f"def {name}(a, b=2):")
            self.known = False
            self.block(3)
            self.add("return a + 1", "end", self.pick(f"{name}(1)", f"x = {name}(2, 3)"))
        else:
            self.count += 1
            name = f"watch{self.count}"
            self.add(f"thread {name}():", "while True:", "x = x + 1", "sync()", "end", "end", f"run {name}()")
        self.known = False


def good_script(rng: np.random.Generator) -> Script:
    """A program whose instructions are all understood; a pose may still have no configuration."""
    writer = Writer(rng)
    writer.block(0)
    writer.block(0)
    writer.motion()
    head, stated = ["global x = 0", "parts = [0, 0]"], rng.random() < 0.3
    poses = any("p[" in line and "movej([" not in line for line in writer.lines if line.startswith("move"))
    poses |= any(name.startswith("p") for name in writer.used)
    if not stated:
        head.insert(0, f"set_tcp(p[{', '.join(map(str, TCP))}])")
        writer.literals += 1
    names = {f"{name[0]}{k}" for name in writer.used for k in [name[1:]]}
    for name in sorted(names | {f"q{name[1:]}" for name in names}):
        k = int(name[1:])
        value = writer.pose(k) if name[0] == "p" else writer.joints(k)
        head.append(f"{writer.pick('global ', 'local ', '')}W{k}_{name[0]} = {value}")
        writer.literals += 1
    tool = ",".join(map(str, TCP)) if stated and poses else ""
    return Script(
        tuple(head), tuple(writer.lines), writer.rows, writer.literals, tool, calls=frozenset(writer.calls)
    )


@dataclass(frozen=True)
class Form:
    """What has to be refused: `lines` in the body; {p} is a pose, {q} its joints, {t} another TCP."""

    name: str
    lines: tuple[str, ...]
    runs: bool = False  # the interpreter can run it: it makes poses wrong where the rewriter does not see it


_OTHER = f"p[{', '.join(map(str, OTHER_TCP))}]"
FORMS = (
    Form("a TCP after a motion", (f"set_tcp({_OTHER})", "movej(get_inverse_kin({p}, {q}))"), runs=True),
    Form("a TCP in a branch", ("if x > 1:", f"set_tcp({_OTHER})", "end")),
    Form(
        "a TCP in a routine",
        ("def tool():", f"set_tcp({_OTHER})", "end", "tool()", "movej(get_inverse_kin({p}, {q}))"),
        runs=True,
    ),
    Form("a TCP in a thread", ("thread tool():", f"set_tcp({_OTHER})", "end", "run tool()")),
    Form("a TCP that is computed", ("set_tcp(mine)",)),
    Form("a TCP by arithmetic", ("set_tcp(pose_trans({p}, {p}))",)),
    Form("the TCP of an inverse", (f"movej(get_inverse_kin({{p}}, {{q}}, 0.1, 0.1, {_OTHER}))",), runs=True),
    Form(
        "the TCP of an inverse by name",
        (f"movej(get_inverse_kin({{p}}, qnear={{q}}, tcp={_OTHER}))",),
        runs=True,
    ),
    Form("an inverse in a variable", ("aim = get_inverse_kin({p}, {q})", "movej(aim)")),
    Form("a pose that is passed", ("def reach(aim):", "movel(aim)", "end", "reach({p})")),
    Form(
        "a literal that is passed", ("def reach(aim):", "movel(aim)", "end", "reach(p[0.4, 0, 0.4, 0, 3, 0])")
    ),
    Form("joints that are passed", ("def reach(aim):", "movej(aim)", "end", "reach({q})"), runs=False),
    Form("a pose for another file", ("foreign({p})",)),
    Form("a literal for another file", ("foreign(p[0.4, 0, 0.4, 0, 3, 0])",)),
    Form("joints for another file", ("foreign([0, 1, 2, 3, 4, 5])",)),
    Form("a literal for a routine stated harmless", ("rq_open(p[0.4, 0, 0.4, 0, 3, 0])",)),
    Form("another file", ("foreign()", "movej(get_inverse_kin({p}, {q}))"), runs=True),
    Form("another file in a condition", ("if foreign():", "x = 1", "end")),
    Form("a thread of another file", ("run foreign()",)),
    Form("a thread that moves", ("thread going():", "movej({q})", "end", "run going()")),
    Form(
        "a thread that moves by a routine",
        ("def f():", "movej({q})", "end", "thread t():", "f()", "end", "run t()"),
    ),
    Form("a pose after a branch", ("if x > 1:", "movej({q})", "end", "movel({p})")),
    Form("a pose in an else", ("if x > 1:", "movej({q})", "else:", "movel({p})", "end")),
    Form("a pose in a loop", ("while x < 3:", "movel({p})", "x = x + 1", "end")),
    Form("a pose in a routine", ("def g():", "movel({p})", "end", "g()")),
    Form("a pose after a routine", ("def h():", "movej({q})", "end", "h()", "movej({p})")),
    Form(
        "a pose after a routine in an expression",
        ("def h():", "movej({q})", "return 1", "end", "x = h()", "movel({p})"),
    ),
    Form("an element", ("{p}[2] = {p}[2] + 0.01", "movej(get_inverse_kin({p}, {q}))")),
    Form("an element of joints", ("{q}[0] = {q}[0] + 0.1", "movej({q})")),
    Form("another value", ("{q} = [0.1, -1.2, 1.2, -1.2, -1.2, 0.3]", "movej({q})"), runs=True),
    Form("a name for a target", ("aim = {q}", "movej(aim)")),
    Form("an offset", ("movel(pose_trans({p}, p[0, 0, 0.05, 0, 0, 0]))",)),
    Form("an offset that is added", ("movel(pose_add({p}, p[0, 0, 0.05, 0, 0, 0]))",)),
    Form("where the arm is", ("here = get_actual_tcp_pose()", "movel(here)")),
    Form("a list of expressions", ("movej([x, 1, 2, 3, 4, 5])",)),
    Form("five joints", ("movej([0, 1, 2, 3, 4])",)),
    Form("a linear motion to joints", ("movel({q})",)),
    Form("a circle", ("movec({p}, {p})",)),
    Form("servo motion", ("servoj({q})",)),
    Form("speed", ("speedl([0, 0, 0.1, 0, 0, 0], 0.5, 1)",)),
    Form("force", ("force_mode({p}, [0, 0, 1, 0, 0, 0], [0, 0, 9, 0, 0, 0], 2, [1, 1, 1, 1, 1, 1])",)),
    Form("free drive", ("freedrive_mode()",)),
    Form("a conveyor", ("track_conveyor_linear(p[0, 1, 0, 0, 0, 0], 500)",)),
    Form("an offset of the path", ("path_offset_enable()",)),
    Form("another base", ("set_base_acceleration([0, 0, 9])",)),
    Form("a method", ('camera = rpc_factory("xmlrpc", "http://a")', "x = camera.pose()")),
    Form("a target that is set in a branch", ("if x > 1:", "aim = [0, 1, 1, 1, 1, 1]", "end", "movej(aim)")),
    Form("a pose that nothing uses", ("other = p[0.4, 0, 0.4, 0, 3, 0]",)),
    Form("joints in an expression", ("x = length([0, 1, 2, 3, 4, 5])",)),
    Form("a number beyond all", ("movej([0, 1e400, 2, 3, 4, 5])",)),
    Form("a routine named as an instruction", ("def sleep(t):", "movej({q})", "end", "sleep(1)")),
    Form("a routine twice", ("def f():", "x = 1", "end", "def f():", "x = 2", "end")),
    Form("two statements", ("x = 1 movej({q})",)),
    Form("half a statement", ("movej({q}",)),
    Form("an end too much", ("end",)),
    Form("a block without an end", ("if x > 1:",)),
    Form("an else without an if", ("else:",)),
    Form("a secondary program", ("sec other():", "x = 1", "end")),
)


def with_form(script: Script, form: Form, place: int) -> Script:
    """The program with a form in its body."""
    lines = [line.format(p="W0_p", q="W0_q") for line in form.lines]
    body = (*script.body[:place], *lines, *script.body[place:])
    calls = script.calls | ({HARMLESS} if any("rq_open" in line for line in lines) else set())
    return replace(script, body=body, form=form.name, calls=frozenset(calls))
