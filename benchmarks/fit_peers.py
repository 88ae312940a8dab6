"""The peers' side of fit_time.py: one cost in numpy, and what each peer makes of it. Nothing of zerobeam.

    python fit_peers.py PEER COST.npz REPEAT

runs in the environment of the peers and prints one line of JSON: the optimum `x`, the `seconds` of each fit,
and how often it `asked` for residuals and Jacobians. The file holds `joints` (N, 6) rad, `spots` (N, 2) mm,
`factor` (N, 2, 2) the Cholesky factors of the residuals' covariances, `mean`, `std`, `start`, `mode` (8,) rad
and mm of the unknowns: the offsets 2 to 6 and the target; `many_joints` (B, N, 6) and `many_spots` (B, N, 2)
are the runs of a batch.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Fit = Callable[[], Array]

TABLE_1 = np.array(  # a, alpha, d, theta of the paper's Table 1, mm and degrees
    [
        (150, -90, 486.5, 0),
        (700, 0, 0, -90),
        (0, 90, 0, 180),
        (0, -90, 600, 0),
        (0, 90, 0, 0),
        (0, 0, 0, 0),
    ]
)
A, ALPHA, D, THETA = (TABLE_1 * [1, np.pi / 180, 1, np.pi / 180]).T
SMALL_STEP = 1e-8  # prior stds: the last of a fit in JAX
POINT = np.array([0.0, 0.0, 65.0])  # on the beam, which is along the flange's x axis


def frames(joints: Array, delta: Array) -> list[Array]:
    """T_0 … T_6, each (N, 4, 4), of the standard DH chain (eq. 1 of the paper), mm."""
    chain = [np.tile(np.eye(4), (len(joints), 1, 1))]
    angles = joints + delta + THETA
    for a, alpha, d, c, s in zip(A, ALPHA, D, np.cos(angles).T, np.sin(angles).T, strict=True):
        ca, sa, zero, one = np.cos(alpha), np.sin(alpha), 0 * c, 0 * c + 1
        rows = [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [zero, sa * one, ca * one, d * one],
            [zero, zero, zero, one],
        ]
        chain.append(chain[-1] @ np.array(rows).transpose(2, 0, 1))
    return chain


class Cost:
    """Half the sum of squares of the whitened residuals and of the priors, over x (8,) rad and mm."""

    def __init__(self, data: Mapping[str, Array]) -> None:
        self.joints, self.spots, self.start, self.mode = (
            np.array(data[name]) for name in ("joints", "spots", "start", "mode")
        )
        self.mean, self.std = np.array(data["mean"]), np.array(data["std"])
        self.begun = (self.start - self.mean) / self.std
        self.many_joints, self.many_spots = np.array(data["many_joints"]), np.array(data["many_spots"])
        self.whiten = np.linalg.inv(data["factor"])
        self.asked: Counter[str] = Counter()

    def unscaled(self, y: Any) -> Array:
        """x (…, 8) of prior stds from the prior mean."""
        return self.mean + self.std * np.asarray(y)

    def residual(self, x: Array) -> Array:
        """(2 N + 8,)"""
        return self.by_flange(frames(self.joints, np.append(0.0, x[:5]))[-1], x)

    def by_flange(self, flange: Array, x: Array) -> Array:
        """The residuals for flange poses (N, 4, 4) that come from elsewhere."""
        self.asked["residual"] += 1
        seen = np.einsum("nji,nj->ni", flange[:, :3, :3], x[5:] - flange[:, :3, 3])
        miss = (seen - POINT)[:, 1:] - self.spots
        return np.append(self.whiten @ miss[:, :, None], (x - self.mean) / self.std)

    def jacobian(self, x: Array) -> Array:
        """(2 N + 8, 8): a turn about axis z_j through o_j moves the target seen by -R'(z_j x (P - o_j))."""
        self.asked["jacobian"] += 1
        *chain, flange = frames(self.joints, np.append(0.0, x[:5]))
        turn = flange[:, :3, :3].transpose(0, 2, 1)[:, 1:]
        arms = [np.cross(t[:, :3, 2], x[5:] - t[:, :3, 3])[:, :, None] for t in chain[1:]]
        own = np.concatenate([*(-turn @ arm for arm in arms), turn], axis=2)
        return np.vstack([(self.whiten @ own).reshape(-1, 8), np.diag(1 / self.std)])

    def differences(self, x: Array) -> Array:
        """The same by central differences with the step of Ceres' own: 1e-6 of the value."""
        steps = np.diag(np.maximum(1e-6 * np.abs(x), 1.5e-8))
        columns = [(self.residual(x + h) - self.residual(x - h)) / (2 * h.sum()) for h in steps]
        return np.stack(columns, axis=1)


def scipy_fit(cost: Cost, jacobian: Callable[[Array], Array] | str) -> Fit:
    from scipy.optimize import least_squares

    return lambda: least_squares(cost.residual, cost.start, jac=jacobian, method="lm", x_scale="jac").x


def pyceres_fit(cost: Cost, jacobian: Callable[[Array], Array]) -> Fit:
    """Ceres' own numeric differences are not for a cost in Python: who has no Jacobian writes them."""
    import pyceres

    class Block(pyceres.CostFunction):
        def __init__(self) -> None:
            super().__init__()
            self.set_num_residuals(cost.spots.size + 8)
            self.set_parameter_block_sizes([8])

        def Evaluate(
            self, parameters: Sequence[Array], residuals: Array, jacobians: Sequence[Array] | None
        ) -> bool:
            residuals[:] = cost.residual(parameters[0])
            if jacobians is not None:
                jacobians[0][:] = jacobian(parameters[0]).ravel()
            return True

    def fit() -> Array:
        x, block, problem = cost.start.copy(), Block(), pyceres.Problem()
        problem.add_residual_block(block, None, [x])
        options, summary = pyceres.SolverOptions(), pyceres.SolverSummary()
        options.linear_solver_type = pyceres.LinearSolverType.DENSE_QR
        pyceres.solve(options, problem, summary)
        return x

    return fit


def pybotics_fit(cost: Cost) -> Fit:
    """As its documentation calibrates: a handler frees some thetas of its chain, scipy does the rest.

    Its rows are modified DH, in which a and alpha belong to the joint before; those of the last are 0 here.
    """
    from pybotics.kinematic_chain import MDHKinematicChain
    from pybotics.optimization import OptimizationHandler
    from pybotics.robot import Robot
    from scipy.optimize import least_squares

    rows = np.column_stack([np.append(0.0, ALPHA[:-1]), np.append(0.0, A[:-1]), THETA, D])
    free = np.zeros(rows.shape, dtype=bool)
    free[1:, 2] = True

    def residual(x: Array, handler: OptimizationHandler) -> Array:
        handler.apply_optimization_vector(THETA[1:] + x[:5])
        return cost.by_flange(np.array([handler.robot.fk(q) for q in cost.joints]), x)

    def fit() -> Array:
        robot = Robot(MDHKinematicChain.from_parameters(rows.ravel()))
        handler = OptimizationHandler(robot, kinematic_chain_mask=free.ravel())
        return least_squares(residual, cost.start, args=(handler,), method="lm", x_scale="jac").x

    return fit


def in_jax(cost: Cost) -> Callable[..., Any]:
    """The residual (2 N + 8,) in JAX, of y (8,) = (x - mean) / std and of the joints and spots of a run."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    mean, std, whiten = (jnp.array(each) for each in (cost.mean, cost.std, cost.whiten))
    of_joint = [(np.cos(alpha), np.sin(alpha), a, d) for a, alpha, d in zip(A, ALPHA, D, strict=True)]

    def residual(y: Any, joints: Any, spots: Any) -> Any:
        x = mean + std * y
        angles = joints + jnp.concatenate([jnp.zeros(1), x[:5]]) + THETA
        # The target is taken into the flange, joint by joint.
        seen = jnp.tile(x[5:], (len(joints), 1))
        for k, (ca, sa, a, d) in enumerate(of_joint):
            c, s = jnp.cos(angles[:, k]), jnp.sin(angles[:, k])
            along, across = c * seen[:, 0] + s * seen[:, 1], c * seen[:, 1] - s * seen[:, 0]
            up = seen[:, 2] - d
            seen = jnp.stack([along - a, ca * across + sa * up, ca * up - sa * across], axis=1)
        miss = (seen - POINT)[:, 1:] - spots
        return jnp.concatenate([(whiten @ miss[:, :, None]).ravel(), y])

    return residual


def gauss_newton(cost: Cost) -> Callable[..., Any]:
    """In JAX, compiled: y (8,) from a start, the joints and the spots of a run."""
    import jax
    import jax.numpy as jnp

    residual = in_jax(cost)

    def step(state: Any, joints: Any, spots: Any) -> Any:
        y, _, count = state
        jacobian = jax.jacfwd(residual)(y, joints, spots)
        change = jnp.linalg.solve(jacobian.T @ jacobian, jacobian.T @ residual(y, joints, spots))
        return y - change, jnp.abs(change).max(), count + 1

    def solve(y: Any, joints: Any, spots: Any) -> Any:
        going = lambda state: (state[1] > SMALL_STEP) & (state[2] < 50)  # noqa: E731
        return jax.lax.while_loop(going, lambda state: step(state, joints, spots), (y, jnp.inf, 0))[0]

    return solve


def jax_fit(cost: Cost) -> Fit:
    import jax

    solve = jax.jit(gauss_newton(cost))
    return lambda: cost.unscaled(solve(cost.begun, cost.joints, cost.spots))


def jax_fits(cost: Cost) -> Fit:
    """All runs of the batch in one call."""
    import jax

    solve = jax.jit(jax.vmap(gauss_newton(cost), in_axes=(None, 0, 0)))
    return lambda: cost.unscaled(solve(cost.begun, cost.many_joints, cost.many_spots))


def optimistix_fit(cost: Cost) -> Fit:
    import jax
    import optimistix

    residual = in_jax(cost)
    solver = optimistix.LevenbergMarquardt(rtol=SMALL_STEP, atol=SMALL_STEP)

    @jax.jit
    def solve(y: Any, joints: Any, spots: Any) -> Any:
        return optimistix.least_squares(lambda y, of: residual(y, *of), solver, y, (joints, spots)).value

    return lambda: cost.unscaled(solve(cost.begun, cost.joints, cost.spots))


def gtsam_fit(cost: Cost) -> Fit:
    """One factor with the exact Jacobian: its own factors know neither DH rows nor beams."""
    import gtsam

    def error(factor: Any, values: Any, jacobians: list[Array] | None) -> Array:
        x = cost.unscaled(values.atVector(factor.keys()[0]))
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(cost.jacobian(x) * cost.std)
        return cost.residual(x)

    graph = gtsam.NonlinearFactorGraph()
    graph.add(gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(cost.spots.size + 8), [0], error))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-10)

    def fit() -> Array:
        start = gtsam.Values()
        start.insert(0, cost.begun)
        found = gtsam.LevenbergMarquardtOptimizer(graph, start, settings).optimize()
        return cost.unscaled(found.atVector(0))

    return fit


def pinocchio_jacobians(cost: Cost) -> Fit:
    """Poses of the flange and Jacobians of the batch's postures, one posture after the other as its Python
    interface has it; the answer is the largest error of a position (mm) against `frames`."""
    import pinocchio

    model, fixed = pinocchio.Model(), pinocchio.SE3.Identity()
    for k, (a, alpha, d, theta) in enumerate(zip(A, ALPHA, D, THETA, strict=True)):
        turned = pinocchio.SE3(pinocchio.utils.rotate("z", theta), np.zeros(3))
        model.addJoint(k, pinocchio.JointModelRZ(), fixed * turned, f"joint{k + 1}")
        fixed = pinocchio.SE3(pinocchio.utils.rotate("x", alpha), np.array([a, 0.0, d]))
    flange = model.addFrame(pinocchio.Frame("flange", 6, 0, fixed, pinocchio.FrameType.OP_FRAME))
    data, postures = model.createData(), cost.many_joints.reshape(-1, 6)
    world = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    places, jacobians = np.empty((len(postures), 3)), np.empty((len(postures), 6, 6))

    def fit() -> Array:
        for k, q in enumerate(postures):
            jacobians[k] = pinocchio.computeFrameJacobian(model, data, q, flange, world)
            places[k] = data.oMf[flange].translation
        return np.array([np.abs(places - frames(postures, np.zeros(6))[-1][:, :3, 3]).max()])

    return fit


def robotkinecal_fit(cost: Cost) -> Fit:
    """Another problem: it knows neither beams, nor offsets alone, nor priors. It asks for whole poses of the
    flange in the base frame (m) and frees all 30 numbers of the chain. It is given the poses of the same
    shots at the offsets of our mode; the answer is the largest position error (mm) that it leaves."""
    import roboticstoolbox as rtb
    from robotkinecal import SerialRobotKineCal
    from spatialmath import SE3

    def metres(pose: Array) -> SE3:
        rotation, place = pose[:3, :3], pose[:3, 3] / 1000
        return SE3.Rt(rotation, place, check=False)

    nominal = [pose[0] for pose in frames(np.zeros((1, 6)), np.zeros(6))]
    links: list[rtb.Link] = []
    for k, pose in enumerate(nominal):
        fixed = rtb.ET.SE3(metres(np.linalg.inv(nominal[max(k - 1, 0)]) @ pose))
        turn, name = ([rtb.ET.Rz()], f"joint{k + 1}") if k < 6 else ([], "flange")
        links.append(rtb.Link(rtb.ETS([fixed, *turn]), name=name, parent=links[-1] if links else None))
    robot = rtb.Robot(links)
    poses = [metres(pose) for pose in frames(cost.joints, np.append(0.0, cost.mode[:5]))[-1]]

    def fit() -> Array:
        calibration = SerialRobotKineCal(robot, "flange")
        calibration.set_observations(list(cost.joints), poses)
        calibration.solve()
        found = [calibration.forward_kinematics(7, q).t for q in cost.joints]
        return np.array([1000 * np.abs(np.array(found) - [pose.t for pose in poses]).max()])

    return fit


PEERS: dict[str, Callable[[Cost], Fit]] = {
    "scipy, 2-point differences": lambda cost: scipy_fit(cost, "2-point"),
    "scipy, exact Jacobians": lambda cost: scipy_fit(cost, cost.jacobian),
    "pyceres, differences in Python": lambda cost: pyceres_fit(cost, cost.differences),
    "pyceres, exact Jacobians": lambda cost: pyceres_fit(cost, cost.jacobian),
    "GTSAM, exact Jacobians": gtsam_fit,
    "optimistix, Levenberg-Marquardt": optimistix_fit,
    "Gauss-Newton in JAX, compiled": jax_fit,
    "pybotics and scipy": pybotics_fit,
    "robotkinecal": robotkinecal_fit,
    "Gauss-Newton in JAX, all runs": jax_fits,
    "pinocchio": pinocchio_jacobians,
}


def main() -> None:
    peer, file, repeat = sys.argv[1:]
    warnings.simplefilter("ignore")
    cost = Cost(np.load(file))
    fit = PEERS[peer](cost)
    answer, seconds = fit(), []
    for _ in range(int(repeat)):
        cost.asked.clear()
        begun = time.perf_counter()
        answer = fit()
        seconds.append(time.perf_counter() - begun)
    print("answer:" + json.dumps({"x": answer.tolist(), "seconds": seconds, "asked": cost.asked}))


if __name__ == "__main__":
    main()
