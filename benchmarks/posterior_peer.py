"""The peers' side of posterior_time.py: the same posterior written again in JAX, and its samplers.

    python posterior_peer.py MODEL.npz ANSWER.npz

runs in the environment of the peers. Nothing of zerobeam is in here: the arm is Table 1 of the paper or read
from a URDF file, the density section 1 of the paper's model with the covariance of each miss by a geometric
Jacobian. Unknowns z (f,) are scaled by their priors; angles are rad, lengths mm.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from numpy.typing import NDArray
from numpyro.infer import MCMC, NUTS

Array = NDArray[np.float64]
Density = Callable[[jax.Array], jax.Array]
CHAINS, OF_EACH = 256, 60  # chains side by side, and draws of each
STEP, STEPS = (0.3, 0.6), (4, 10)  # of a leapfrog, and how many a draw: the best count
BATCH, BATCHES = 2000, 20  # draws in one call

TABLE_1 = [  # a, alpha, d, theta, mm and degrees
    (150, -90, 486.5, 0),
    (700, 0, 0, -90),
    (0, 90, 0, 180),
    (0, -90, 600, 0),
    (0, 90, 0, 0),
    (0, 0, 0, 0),
]


def turn(axis: int, angle: float) -> Array:
    """(4, 4) about a coordinate axis."""
    pose = np.eye(4)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    pose[j, j] = pose[k, k] = np.cos(angle)
    pose[k, j] = np.sin(angle)
    pose[j, k] = -pose[k, j]
    return pose


def shift(x: float, y: float, z: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def dh_arm() -> tuple[list[Array], Array]:
    """What is fixed before each joint (a turn about z), and after the last."""
    fixed = [np.eye(4)]
    for a, alpha, d, theta in TABLE_1:
        fixed.append(turn(2, np.radians(theta)) @ shift(a, 0, d) @ turn(0, np.radians(alpha)))
    return fixed[:-1], fixed[-1]


def urdf_arm(file: Path, base: str, tip: str) -> tuple[list[Array], Array]:
    """The same from a URDF file whose joints turn about their z axes."""
    joints = {j.find("child").get("link"): j for j in ElementTree.parse(file).iter("joint")}  # type: ignore[union-attr]
    fixed, pending, way = [], np.eye(4), []
    while tip != base:
        way.append(joints[tip])
        tip = way[-1].find("parent").get("link")  # type: ignore[union-attr, assignment]
    for joint in reversed(way):
        origin = joint.find("origin")
        roll, pitch, yaw = map(float, origin.get("rpy", "0 0 0").split())  # type: ignore[union-attr]
        place = 1000 * np.array(origin.get("xyz", "0 0 0").split(), dtype=float)  # type: ignore[union-attr]
        pending = pending @ shift(*place) @ turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)
        if joint.get("type") != "fixed":
            assert joint.find("axis").get("xyz") == "0 0 1"  # type: ignore[union-attr]
            fixed.append(pending)
            pending = np.eye(4)
    return fixed, pending


def link_frame(step: Array) -> tuple[Array, bool]:
    """(4, 4) where a link's parameters act, between a joint and the next one at `step`: on the next axis
    where it is nearest to this one, z along this one, x along the common normal; of nearly parallel axes at
    the next joint. And whether they are parallel."""
    place, along = step[:3, 3], step[:3, 2]
    normal, foot = np.cross([0.0, 0.0, 1.0], along), place
    parallel = np.linalg.norm(normal) < np.sin(np.radians(5))
    if parallel:
        normal = place * [1, 1, 0] if np.hypot(*place[:2]) > 1e-6 else step[:3, 0] * [1, 1, 0]
    else:
        foot = place - (place[:2] @ along[:2]) / (along[:2] @ along[:2]) * along
    x = normal / np.linalg.norm(normal)
    x = -x if x @ step[:3, 0] < -1e-9 else x
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1], frame[:3, 3] = x, np.cross([0.0, 0.0, 1.0], x), foot
    return frame, bool(parallel)


def moved_link(step: Array, values: jax.Array) -> jax.Array:
    """`step` (4, 4) of a link whose a, alpha and d (beta of parallel axes) are off by `values` (3,); of the
    last one a, b, d, alpha and beta by (5,)."""
    frame, parallel = link_frame(step)
    zero, one = 0.0 * values[0], 1.0 + 0.0 * values[0]
    if len(values) == 5:
        a, b, d, alpha, beta = values
    else:
        (a, alpha, other), b = values, zero
        d, beta = (zero, other) if parallel else (other, zero)
    ca, sa, cb, sb = jnp.cos(alpha), jnp.sin(alpha), jnp.cos(beta), jnp.sin(beta)
    about_x = jnp.array(
        [[one, zero, zero, a], [zero, ca, -sa, b], [zero, sa, ca, d], [zero, zero, zero, one]]
    )
    about_y = jnp.array(
        [[cb, zero, sb, zero], [zero, one, zero, zero], [-sb, zero, cb, zero], [zero, zero, zero, one]]
    )
    return frame @ about_x @ about_y @ (np.linalg.inv(frame) @ step)


def log_density(model: dict[str, Array]) -> Density:
    """log posterior of z (f,), up to a constant."""
    file = str(model["urdf"])
    fixed, last = urdf_arm(Path(file), "panda_link0", "panda_hand_tcp") if file else dh_arm()
    joints, spots, index, free = (model[k] for k in ("joints", "spots", "target_index", "free"))
    n, targets, variances = joints.shape[1], int(index.max()) + 1, model["variances"]
    first, second = model["pairs"].T
    links = 3 * (n - 1) + 5 if model["links"] else 0
    arm = (fixed, last)

    def value(z: jax.Array) -> jax.Array:
        x = jnp.asarray(model["mean"]).at[free].add(z * model["std"][free])
        after = n + links
        places, tool = x[after : after + 3 * targets].reshape(-1, 3), x[after + 3 * targets :]
        fixed, last = arm
        if links:
            each = [*x[n : after - 5].reshape(n - 1, 3), x[after - 5 : after]]
            steps = zip([*fixed[1:], last], each, strict=True)
            *moved, last = (moved_link(step, own) for step, own in steps)
            fixed = [fixed[0], *moved]
        rotation, origin = jnp.eye(3), jnp.zeros(3)
        angles, target, arms = joints + x[:n], places[index], []
        for k in range(n):
            origin = origin + rotation @ fixed[k][:3, 3]
            rotation = rotation @ fixed[k][:3, :3]
            arms.append(jnp.cross(rotation[..., :, 2], target - origin))
            c, s = jnp.cos(angles[:, k])[:, None], jnp.sin(angles[:, k])[:, None]
            one, two, three = rotation[..., 0], rotation[..., 1], rotation[..., 2]
            rotation = jnp.stack([c * one + s * two, c * two - s * one, three + 0 * c], axis=-1)
        origin = origin + rotation @ last[:3, 3]
        rotation = rotation @ last[:3, :3]
        seen = jnp.einsum("nji,nj->ni", rotation, target - origin)
        point, across = probe(tool) if spots.shape[1] == 3 else beam(tool)
        miss = (seen - point) @ across - spots
        by_joints = -jnp.einsum("nji,njk,id->ndk", rotation, jnp.stack(arms, axis=2), across)
        covariance = jnp.einsum("ndk,nek,k->nde", by_joints, by_joints, variances[:-1])
        quad = squares(miss, covariance + variances[-1] * jnp.eye(spots.shape[1]))
        apart = jnp.sqrt(((places[second] - places[first]) ** 2).sum(axis=1))
        stated = (((apart - model["apart"]) / model["apart_sigma"]) ** 2).sum()
        return -(quad + stated + z @ z) / 2

    return value


def moved_arm(values: jax.Array) -> tuple[list[Array], Array]:
    """`dh_arm` with links 1 to 5 off by `values` (5, 3); the last one is nominal."""
    fixed, last = dh_arm()
    steps = zip(fixed[1:], values, strict=True)
    return [fixed[0], *(moved_link(step, own) for step, own in steps)], last


def tracker_density(model: dict[str, Array]) -> Density:
    """log posterior of z (f,) of a tracker set, up to a constant: offsets, links, a reflector in the flange
    frame, origin and rotation vector of the tracker's frame. `links` are the places of links 1 to 5 in x."""
    joints, readings, free, variances = (model[k] for k in ("joints", "spots", "free", "variances"))
    n = joints.shape[1]

    def value(z: jax.Array) -> jax.Array:
        x = jnp.asarray(model["mean"]).at[free].add(z * model["std"][free])
        fixed, last = moved_arm(x[model["links"]].reshape(n - 1, 3))
        reflector, stand, vector = x[-9:-6], x[-6:-3], x[-3:]
        rotation, origin, angles = jnp.eye(3), jnp.zeros(3), joints + x[:n]
        axes = []
        for k in range(n):
            origin = origin + rotation @ fixed[k][:3, 3]
            rotation = rotation @ fixed[k][:3, :3]
            axes.append((rotation[..., :, 2], origin))
            c, s = jnp.cos(angles[:, k])[:, None], jnp.sin(angles[:, k])[:, None]
            one, two, three = rotation[..., 0], rotation[..., 1], rotation[..., 2]
            rotation = jnp.stack([c * one + s * two, c * two - s * one, three + 0 * c], axis=-1)
        point = origin + rotation @ (last[:3, 3] + last[:3, :3] @ reflector)
        angle = jnp.sqrt(vector @ vector)
        k1, k2, k3 = vector / angle
        cross = jnp.array([[0.0, -k3, k2], [k3, 0.0, -k1], [-k2, k1, 0.0]])
        frame = jnp.eye(3) + jnp.sin(angle) * cross + (1 - jnp.cos(angle)) * cross @ cross
        by_joints = jnp.stack([jnp.cross(axis, point - start) @ frame for axis, start in axes], axis=2)
        covariance = jnp.einsum("ndk,nek,k->nde", by_joints, by_joints, variances[:-1])
        miss = (point - stand) @ frame - readings
        return -(squares(miss, covariance + variances[-1] * jnp.eye(3)) + z @ z) / 2

    return value


def beam(tool: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Point (3,) and axes across (3, 2) of a beam near the flange's x axis: tilts and shifts, or none."""
    point, y, z = jnp.array([0.0, 0.0, 65.0]), jnp.array([0.0, 1.0, 0.0]), jnp.array([0.0, 0.0, 1.0])
    if len(tool) == 0:
        return point, jnp.stack([y, z], axis=1)
    along = jnp.array([1.0, jnp.tan(tool[0]), jnp.tan(tool[1])])
    along = along / jnp.sqrt(along @ along)
    b1 = y - (y @ along) * along
    b1 = b1 / jnp.sqrt(b1 @ b1)
    return point + tool[2] * y + tool[3] * z, jnp.stack([b1, jnp.cross(along, b1)], axis=1)


def probe(tool: jax.Array) -> tuple[jax.Array, jax.Array]:
    return tool, jnp.eye(3)


def squares(miss: jax.Array, covariance: jax.Array) -> jax.Array:
    """Sum over shots of m' S^-1 m; Cholesky's factor written out, which XLA fuses."""
    quad = jnp.zeros(())
    factor: dict[tuple[int, int], jax.Array] = {}
    white: list[jax.Array] = []
    for i in range(miss.shape[1]):
        for j in range(i + 1):
            rest = covariance[:, i, j] - sum(factor[i, k] * factor[j, k] for k in range(j))
            factor[i, j] = jnp.sqrt(rest) if i == j else rest / factor[j, j]
        white.append((miss[:, i] - sum(factor[i, k] * white[k] for k in range(i))) / factor[i, i])
        quad += (white[i] ** 2).sum()
    return quad


class Peer:
    """The posterior in coordinates w (f,) whitened by the fit, and its samplers, each at its best: what is
    timed is sampling alone, compiled and warm."""

    def __init__(self, model: dict[str, Array]) -> None:
        self.chains, self.warmup, self.draws, self.seed = (int(v) for v in model["settings"])
        self.value = (tracker_density if "tracker" in model else log_density)(model)
        self.centre, self.factor = model["centre"], model["factor"]
        self.size = len(self.centre)

    def at(self, w: jax.Array) -> jax.Array:
        """ln p of w (f,), up to a constant."""
        return self.value(self.centre + self.factor @ w)

    def key(self, number: int) -> jax.Array:
        return jax.random.PRNGKey(self.seed + number)

    def timed(self, call: Callable[[], tuple[jax.Array, ...]]) -> tuple[tuple[Array, ...], float]:
        """What the second call gives, and its seconds."""
        for _ in range(2):
            begun = time.perf_counter()
            found = tuple(np.asarray(part) for part in jax.block_until_ready(call()))
            seconds = time.perf_counter() - begun
        return found, seconds

    def nuts(self) -> dict[str, Array | float]:
        """NumPyro's, a chain on each core."""
        sampler = MCMC(
            NUTS(potential_fn=lambda w: -self.at(w)),
            num_warmup=self.warmup,
            num_samples=self.draws,
            num_chains=self.chains,
            chain_method="parallel",
            progress_bar=False,
        )
        start = jax.random.normal(self.key(0), (self.chains, self.size))
        sampler.run(self.key(1), init_params=start)

        def once() -> tuple[jax.Array, ...]:
            sampler.post_warmup_state = sampler.last_state
            sampler.run(self.key(2))
            return (sampler.get_samples(group_by_chain=True),)

        (found,), seconds = self.timed(once)
        return {"z": self.unwhitened(found), "seconds": seconds}

    def hmc(self) -> dict[str, Array | float]:
        """BlackJAX's, many chains side by side in one program, with the step and the number of steps that
        jump farthest a gradient."""

        def walk(state: object, key: jax.Array, step: float, steps: int) -> tuple[object, jax.Array]:
            kernel = blackjax.hmc(self.at, step, jnp.ones(self.size), steps)

            def one(state: object, key: jax.Array) -> tuple[object, jax.Array]:
                state, _ = jax.vmap(kernel.step)(jax.random.split(key, CHAINS), state)
                return state, state.position  # type: ignore[attr-defined]

            return jax.lax.scan(one, state, jax.random.split(key, OF_EACH))

        walked = jax.jit(walk)
        start = jax.random.normal(self.key(0), (CHAINS, self.size))
        state = jax.vmap(lambda w: blackjax.hmc.init(w, self.at))(start)

        def jumped(setting: tuple[float, int]) -> float:
            _, found = walked(state, self.key(1), *setting)
            return float((jnp.diff(found[OF_EACH // 2 :], axis=0) ** 2).sum()) / setting[1]

        best = max(((step, steps) for step in STEP for steps in STEPS), key=jumped)
        state, _ = walked(state, self.key(2), *best)
        (found,), seconds = self.timed(lambda: (walked(state, self.key(3), *best)[1],))
        return {"z": self.unwhitened(found.transpose(1, 0, 2)), "seconds": seconds}

    def importance(self) -> dict[str, Array | float]:
        """Draws of a multivariate t around the fit, weighted."""
        nu = max(6.0, 2.0 * self.size)

        def weighted(key: jax.Array) -> tuple[jax.Array, jax.Array]:
            first, second = jax.random.split(key)
            normal = jax.random.normal(first, (BATCH, self.size))
            chi2 = 2 * jax.random.gamma(second, nu / 2, (BATCH,))
            w = normal * jnp.sqrt(nu / chi2)[:, None]
            proposed = -(nu + self.size) / 2 * jnp.log1p((w**2).sum(axis=1) / nu)
            return w, jax.vmap(self.at)(w) - proposed

        many = jax.jit(lambda key: jax.lax.map(weighted, jax.random.split(key, BATCHES)))
        (w, log_weights), seconds = self.timed(lambda: many(self.key(0)))
        return {
            "z": self.unwhitened(w.reshape(1, -1, self.size)),
            "log_weights": log_weights.reshape(-1),
            "seconds": seconds,
        }

    def unwhitened(self, w: Array) -> Array:
        return np.asarray(self.centre + w @ self.factor.T)


def main() -> None:
    model = dict(np.load(sys.argv[1]))
    numpyro.set_host_device_count(int(model["settings"][0]))
    jax.config.update("jax_enable_x64", True)
    peer = Peer(model)
    answer = {"checked": np.array(jax.jit(jax.vmap(peer.value))(model["points"]))}
    samplers = {
        "NumPyro NUTS": peer.nuts,
        f"BlackJAX HMC, {CHAINS} chains side by side": peer.hmc,
        "importance sampling in JAX": peer.importance,
    }
    for name, sampled in samplers.items():
        answer |= {f"{name}|{key}": np.asarray(part) for key, part in sampled().items()}
    np.savez(sys.argv[2], **answer)


if __name__ == "__main__":
    main()
