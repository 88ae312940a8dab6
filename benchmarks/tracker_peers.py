"""The peers' side of tracker_table.py: simulated tracker sets in numpy, and what each peer makes of a set.

    python tracker_peers.py PEER SETS.npz
    python tracker_peers.py arm ARM.npz

runs in the environment of the peers and prints one line of JSON, a list of answers. Nothing of zerobeam is in
here. The file holds `rows` (6, 4) of the nominal arm, and stacked over S sets `joints` (S, N, 6) rad,
`measured` (S, N, 3) mm in the tracker's frame, `held_joints` (S, M, 6), and `noise` (2,): the std of a joint,
rad, and of a coordinate, mm. Each peer starts at nominal links, with frame and reflector fitted to them.

An answer has `positions` (M, 3) mm predicted at the held-out joints, `offsets` (6,) rad and their `std`, None
where the peer has none, what it `says`, and the `seconds` of a core.

With `arm` pybotics simulates: positions (N, 3) mm of the reflector of an arm with the `rows`, without noise.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import itertools
import json
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# a, alpha, d, theta of the paper's Table 1, mm and rad
IRB1600 = np.array(
    [
        (150, -90, 486.5, 0),
        (700, 0, 0, -90),
        (0, 90, 0, 180),
        (0, -90, 600, 0),
        (0, 90, 0, 0),
        (0, 0, 0, 0),
    ]
) * [1, np.pi / 180, 1, np.pi / 180]
A, ALPHA, D, THETA = range(4)
LOWER, UPPER = np.radians([[-60, -20, -40, -120, -90, -150], [60, 50, 30, 120, 90, 150]])
PRIOR = np.array([0.3, np.radians(0.1), 0.3, np.radians(2.0)])  # of a, alpha, d, theta: a typical arm
MM_PER_M = 1000.0


def cross_matrix(vector: Array) -> Array:
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def turn_about(vector: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) of a rotation vector (3,) rad, and its left Jacobian (3, 3)."""
    angle, k = float(np.linalg.norm(vector)), cross_matrix(vector)
    if angle < 1e-9:
        return np.eye(3) + k, np.eye(3) + k / 2
    s, c = np.sin(angle), (1 - np.cos(angle)) / angle**2
    return np.eye(3) + s / angle * k + c * k @ k, np.eye(3) + c * k + (angle - s) / angle**3 * k @ k


@dataclass(frozen=True)
class Model:
    """Standard DH rows, a frame and a reflector. Unknowns x (33,): deviations of the rows (24), rotation
    vector and shift of the tracker's frame from `turn` and `shift`, the reflector in the flange frame."""

    rows: Array
    turn: Array
    shift: Array

    def chain(self, joints: Array, rows: Array, beta: float = 0.0) -> list[tuple[Array, Array]]:
        """Rotations (N, 3, 3) and origins (N, 3) of T_0 … T_6; `beta` rad turns link 2 about its y axis."""
        rotation, origin = np.tile(np.eye(3), (len(joints), 1, 1)), np.zeros((len(joints), 3))
        frames = [(rotation, origin)]
        for k, (a, alpha, d, theta) in enumerate(rows):
            c, s = np.cos(joints[:, k] + theta), np.sin(joints[:, k] + theta)
            step = np.zeros((len(joints), 3, 3))
            step[:, 0, 0], step[:, 0, 1], step[:, 1, 0], step[:, 1, 1], step[:, 2, 2] = c, -s, s, c, 1
            origin = origin + rotation @ [0, 0, d] + a * (rotation @ step)[:, :, 0]
            rotation = rotation @ step @ turn_about(np.array([alpha, 0, 0]))[0]
            if k == 1:
                rotation = rotation @ turn_about(np.array([0, beta, 0]))[0]
            frames.append((rotation, origin))
        return frames

    def positions(self, joints: Array, x: Array, beta: float = 0.0) -> Array:
        """(N, 3) mm in the tracker's frame."""
        rotation, origin = self.chain(joints, self.rows + x[:24].reshape(6, 4), beta)[-1]
        return (origin + rotation @ x[30:]) @ (turn_about(x[24:27])[0] @ self.turn).T + self.shift + x[27:30]

    def jacobian(self, joints: Array, x: Array) -> Array:
        """(N, 3, 33): each number of a row moves the reflector as a screw about or along its own axis."""
        frames = self.chain(joints, self.rows + x[:24].reshape(6, 4))
        small, left = turn_about(x[24:27])
        turn = small @ self.turn
        rotation, origin = frames[-1]
        point = origin + rotation @ x[30:]
        columns = []
        for (before, start), (after, end) in itertools.pairwise(frames):
            along, normal = before[:, :, 2], after[:, :, 0]
            by_theta, by_alpha = np.cross(along, point - start), np.cross(normal, point - end)
            columns += [normal, by_alpha, along, by_theta]
        by_turn = [np.cross(axis, point @ turn.T) for axis in left.T]
        return np.stack(
            [
                *(column @ turn.T for column in columns),
                *by_turn,
                *(np.tile(axis, (len(joints), 1)) for axis in np.eye(3)),
                *((turn @ rotation).transpose(2, 0, 1)),
            ],
            axis=2,
        )


@dataclass(frozen=True)
class Truth:
    """A simulated set: what was recorded, where the reflector really is at the held-out joints, and the arm
    with its unknowns."""

    joints: Array
    measured: Array
    held_joints: Array
    held: Array
    model: Model
    x: Array
    beta: float


def simulated(
    rng: np.random.Generator,
    count: int,
    noise: tuple[float, float],
    *,
    held: int = 200,
    still: Sequence[int] = (),
    beta: bool = True,
) -> Truth:
    """`count` measurements of an IRB 1600 that deviates by the typical tolerances, offsets by 1°; the joints
    `still` never move. `noise` is the std of a joint, rad, and of a coordinate, mm."""
    model = Model(IRB1600, turn_about(rng.normal(size=3))[0], 2000 * rng.normal(size=3))
    rows = PRIOR / [1, 1, 1, 2] * rng.normal(size=(6, 4))
    rows[0, [D, THETA]] = rows[1, D] = 0.0  # joint 1 is the base frame; d of parallel axes is that of link 3
    rows[5] = 0.0  # the last link is the reflector's, and the flange frame follows joint 6
    reflector = np.array([80.0, 30.0, 120.0]) + 5 * rng.normal(size=3)
    x = np.concatenate([rows.ravel(), np.zeros(6), reflector])
    tilt = np.radians(0.1) * rng.normal() * beta
    q = rng.uniform(LOWER, UPPER, size=(count, 6))
    q[:, list(still)] = (LOWER + 0.7 * (UPPER - LOWER))[list(still)]
    held_joints = rng.uniform(LOWER, UPPER, size=(held, 6))
    measured = model.positions(q, x, tilt) + noise[1] * rng.normal(size=(count, 3))
    recorded = q + noise[0] * rng.normal(size=q.shape)
    recorded[:, list(still)] = q[:, list(still)]  # an encoder that does not move reads the same
    return Truth(recorded, measured, held_joints, model.positions(held_joints, x, tilt), model, x, tilt)


class Data(NamedTuple):
    """One set as a peer gets it, with the model at its start; `sigma` mm of a coordinate, joints included."""

    joints: Array
    measured: Array
    held_joints: Array
    model: Model
    start: Array
    sigma: float


def started(rows: Array, joints: Array, measured: Array, held_joints: Array, noise: Array) -> Data:
    """Frame and reflector of nominal links: Kabsch, then Gauss-Newton."""
    flange = Model(rows, np.eye(3), np.zeros(3))
    x = np.zeros(33)
    points = flange.positions(joints, x)
    centre, other = measured.mean(axis=0), points.mean(axis=0)
    u, _, v = np.linalg.svd((measured - centre).T @ (points - other))
    turn = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    shift = centre - turn @ other
    for _ in range(20):
        model = Model(rows, turn, shift)
        by = model.jacobian(joints, x)[:, :, 24:].reshape(-1, 9)
        step = np.linalg.lstsq(by, (measured - model.positions(joints, x)).ravel(), rcond=1e-9)[0]
        turn, shift = turn_about(step[:3])[0] @ turn, shift + step[3:6]
        x[30:] += step[6:]
    by_joints = model.jacobian(joints, x)[:, :, THETA:24:4]
    sigma = float(np.sqrt(noise[1] ** 2 + noise[0] ** 2 * (by_joints**2).sum(axis=2).mean()))
    return Data(joints, measured, held_joints, model, x, sigma)


def pyceres_answer(data: Data) -> dict[str, Any]:
    """As industrial_calibration sets it up: all DH numbers in one block with priors, frame and reflector in
    others; the covariance by SVD without its null space. Kinder than it: each prior is the arm's tolerance,
    not one number for all, and positions are weighted."""
    import pyceres

    model, sizes = data.model, [24, 6, 3]
    starts = np.cumsum(sizes)[:-1]

    class Positions(pyceres.CostFunction):
        def __init__(self) -> None:
            super().__init__()
            self.set_num_residuals(data.measured.size)
            self.set_parameter_block_sizes(sizes)

        def Evaluate(
            self, parameters: Sequence[Array], residuals: Array, jacobians: Sequence[Array | None] | None
        ) -> bool:
            x = np.concatenate(parameters)
            residuals[:] = ((model.positions(data.joints, x) - data.measured) / data.sigma).ravel()
            if jacobians is not None:
                by = model.jacobian(data.joints, x).reshape(-1, 33) / data.sigma
                for block, part in zip(jacobians, np.split(by, starts, axis=1), strict=True):
                    if block is not None:
                        block[:] = part.ravel()
            return True

    class Priors(pyceres.CostFunction):
        def __init__(self) -> None:
            super().__init__()
            self.set_num_residuals(24)
            self.set_parameter_block_sizes([24])

        def Evaluate(
            self, parameters: Sequence[Array], residuals: Array, jacobians: Sequence[Array | None] | None
        ) -> bool:
            std = np.tile(PRIOR, 6)
            residuals[:] = parameters[0] / std
            if jacobians is not None and jacobians[0] is not None:
                jacobians[0][:] = np.diag(1 / std).ravel()
            return True

    blocks = np.split(data.start.copy(), starts)
    problem = pyceres.Problem()
    positions, priors = Positions(), Priors()
    problem.add_residual_block(positions, None, blocks)
    problem.add_residual_block(priors, None, blocks[:1])
    options, summary = pyceres.SolverOptions(), pyceres.SolverSummary()
    options.linear_solver_type = pyceres.LinearSolverType.DENSE_QR
    options.max_num_iterations = 150
    options.minimizer_progress_to_stdout = False
    pyceres.solve(options, problem, summary)
    how = pyceres.CovarianceOptions()
    how.algorithm_type = pyceres.CovarianceAlgorithmType.DENSE_SVD
    how.null_space_rank = -1
    covariance, std, says = pyceres.Covariance(how), None, summary.termination_type.name
    if covariance.compute([(blocks[0], blocks[0])], problem):
        block = np.asarray(covariance.get_covariance_block(blocks[0], blocks[0])).reshape(24, 24)
        std = np.sqrt(np.diag(block))[THETA::4].tolist()
    else:
        says += ", no covariance"
    x = np.concatenate(blocks)
    return {
        "positions": model.positions(data.held_joints, x),
        "offsets": x[THETA:24:4].tolist(),
        "std": std,
        "says": says,
    }


def pybotics_robot(model: Model, x: Array) -> Any:
    """The arm of `model` at x, whose link 6 and frame are nominal, as a robot of pybotics."""
    from pybotics.kinematic_chain import MDHKinematicChain
    from pybotics.robot import Robot

    rows = model.rows + x[:24].reshape(6, 4)
    robot = Robot(MDHKinematicChain.from_parameters(modified(rows).ravel()))
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = model.turn, model.shift
    robot.world_frame = frame
    robot.tool.position = x[30:]
    return robot


def simulated_by_pybotics(arm: Mapping[str, Array]) -> Array:
    """(N, 3) mm without noise, of the `rows`, `turn`, `shift`, `x` and `joints` (N, 6) of an arm."""
    robot = pybotics_robot(Model(arm["rows"], arm["turn"], arm["shift"]), arm["x"])
    return np.array([robot.fk(q)[:3, 3] for q in arm["joints"]])


def pybotics_answer(data: Data) -> dict[str, Any]:
    """As its documentation calibrates: all MDH numbers, tool and world are freed, and scipy minimises the
    distances. Its rows have a and alpha of the joint before; those of the last joint are the tool's."""
    from pybotics.optimization import OptimizationHandler, optimize_accuracy
    from scipy.optimize import least_squares

    robot = pybotics_robot(data.model, data.start)
    free = [True, True, True, False, False, False]
    handler = OptimizationHandler(
        robot, kinematic_chain_mask=[True] * 24, tool_mask=free, world_mask=[True] * 6
    )
    start = handler.generate_optimization_vector()
    done = least_squares(
        optimize_accuracy, start, args=(handler, data.joints, data.measured), x_scale="jac", max_nfev=100
    )
    handler.apply_optimization_vector(done.x)
    theta = done.x[:24].reshape(6, 4)[:, 2] - data.model.rows[:, THETA]
    return {
        "positions": np.array([handler.robot.fk(q)[:3, 3] for q in data.held_joints]),
        "offsets": theta.tolist(),
        "std": None,
        "says": done.message,
    }


def modified(rows: Array) -> Array:
    """(6, 4) alpha, a, theta, d of modified DH whose last a and alpha are 0, from standard DH rows."""
    before = np.vstack([np.zeros(4), rows[:-1]])
    return np.column_stack([before[:, ALPHA], before[:, A], rows[:, THETA], rows[:, D]])


def robotkinecal_answer(data: Data) -> dict[str, Any]:
    """From positions, in metres; the screw axes of its answer have no offsets. It states one number for each
    joint, the norm of four variances in a random basis, of which no interval comes."""
    import roboticstoolbox as rtb
    from robotkinecal import SerialRobotKineCal
    from spatialmath import SE3

    still = np.zeros((1, 6))
    world = SE3.Rt(data.model.turn, data.model.shift / MM_PER_M, check=False)
    poses = [
        SE3.Rt(turn[0], at[0] / MM_PER_M, check=False)
        for turn, at in data.model.chain(still, data.model.rows)
    ]
    links: list[Any] = []
    for k, pose in enumerate(poses):
        fixed = poses[k - 1].inv() * pose if k else world * pose
        if k == 6:
            fixed = fixed * SE3(*(data.start[30:] / MM_PER_M))
        turn, name = ([rtb.ET.Rz()], f"joint{k + 1}") if k < 6 else ([], "reflector")
        links.append(
            rtb.Link(rtb.ETS([rtb.ET.SE3(fixed), *turn]), name=name, parent=links[-1] if links else None)
        )
    calibration = SerialRobotKineCal(rtb.Robot(links), "reflector")
    calibration.set_observations(list(data.joints), list(data.measured / MM_PER_M))
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        result = calibration.solve()
    ended = "converged" if result.has_converged else "diverging" if result.is_diverging else "stopped"
    lines = printed.getvalue().splitlines()
    joints = {line.partition("(")[2].partition(",")[0] for line in lines if line.startswith("Parameter")}
    positions = [calibration.forward_kinematics(7, q).t for q in data.held_joints]
    return {
        "positions": MM_PER_M * np.array(positions),
        "offsets": None,
        "std": None,
        "says": f"{ended}; not identifiable: {', '.join(sorted(joints)) or 'none'}",
    }


PEERS: dict[str, Callable[[Data], dict[str, Any]]] = {
    "pyceres": pyceres_answer,
    "pybotics": pybotics_answer,
    "robotkinecal": robotkinecal_answer,
}

IMPORTS = {  # before the clock runs
    "pyceres": ("pyceres",),
    "pybotics": ("pybotics.optimization", "scipy.optimize"),
    "robotkinecal": ("roboticstoolbox", "robotkinecal", "spatialmath"),
}


def main() -> None:
    peer, file = sys.argv[1:]
    warnings.simplefilter("ignore")
    if peer == "arm":
        print("answers:" + json.dumps(simulated_by_pybotics(np.load(file)).tolist()))
        return
    np.random.seed(0)  # noqa: NPY002 - robotkinecal's bases are random
    for module in IMPORTS[peer]:
        importlib.import_module(module)
    sets, answers = np.load(file), []
    for joints, measured, held in zip(sets["joints"], sets["measured"], sets["held_joints"], strict=True):
        data = started(sets["rows"], joints, measured, held, sets["noise"])
        begun = time.process_time()
        answer = PEERS[peer](data)
        answer["seconds"] = time.process_time() - begun
        answer["positions"] = answer["positions"].tolist()
        answers.append(answer)
    print("answers:" + json.dumps(answers))


if __name__ == "__main__":
    main()
