"""Does the judge find the peak of a tool's speed and of torques, whatever the arm and the motion?

Random arms of turning and sliding joints about any axes, with random masses and random motions of
cubic and quintic pieces: speeds and torques are compared with Pinocchio's at samples, the peaks
with those of dense samples.

    python tests/soak.py arms
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from cyclopts import Parameter

from trajopt.core.arrays import Array
from trajopt.core.bodies import Masses, body, described
from trajopt.core.chain import LinkChain, LinkPoint, origin_poses
from trajopt.core.limits import Limit, LinkSpeed, ToolSpeed, Torque
from trajopt.core.trajectory import Trajectory

_SAMPLES = 2_000
_AT_ENDS = 1e-13  # share of a piece from its ends, where velocities jump
_COMPARED = 5  # samples whose speed Pinocchio gives, too


class Tried(NamedTuple):
    """One arm and motion.

    Attributes:
        apart: largest difference of a speed from Pinocchio's, relative to the peak.
        above: the judge's peak over that of samples, minus 1.
    """

    apart: float
    above: float


def main(count: Annotated[int, Parameter(help="Arms.")] = 1000, *, quick: bool = False) -> None:
    """Try random arms, and print the largest differences."""
    wrong = False
    for what, judged in {"speeds": tried, "links": tried_links, "torques": tried_torque}.items():
        found = [judged(seed) for seed in range(30 if quick else count)]
        apart, above = np.array(found).T
        print(f"{len(found)} arms; {what} differ from Pinocchio's by {apart.max():.1e} at most;")
        over = f"{above.min():.1e} to {above.max():.1e}"
        print(f"their peaks are above those of {_SAMPLES} samples by {over}")
        wrong |= bool(apart.max() > 1e-12 or above.min() < -1e-12)
    if wrong:
        raise SystemExit(1)


def tried(seed: int) -> Tried:
    """Judge the tool's speed in a random motion of a random arm."""
    rng = np.random.default_rng([9, seed])
    joints = int(rng.integers(1, 8))
    chain = drawn_chain(rng, joints)
    limit = ToolSpeed.read(1.0, joints).for_chain(chain)
    return _compared(chain, limit, _motion(rng, joints), [chain.tool_point])


def tried_links(seed: int) -> Tried:
    """Judge the speeds of a point of each link."""
    rng = np.random.default_rng([11, seed])
    joints = int(rng.integers(1, 8))
    names = [f"link {joint}" for joint in range(joints)]
    chain = drawn_chain(rng, joints).named(names)
    places = rng.uniform(-0.3, 0.3, (joints, 3))
    points = [LinkPoint(joint, place) for joint, place in enumerate(places)]
    asked = {
        own: {"speed": 1.0, "xyz": xyz.tolist()} for own, xyz in zip(names, places, strict=True)
    }
    limit = LinkSpeed.read(asked, joints).for_chain(chain)
    return _compared(chain, limit, _motion(rng, joints), points)


def _compared(chain: LinkChain, limit: Limit, motion: Trajectory, points: list[LinkPoint]) -> Tried:
    shares = np.linspace(_AT_ENDS, 1 - _AT_ENDS, _SAMPLES // len(motion.lengths))
    times = np.ravel(motion.breaks[:-1, None] + shares * motion.lengths[:, None])
    peak = max(float(own.max()) for own in limit.along(motion, times).values())
    at = times[:: _SAMPLES // _COMPARED]
    found = np.array(list(limit.along(motion, at).values()))
    apart = np.abs(found - _speeds(chain, motion, at, points)).max()
    return Tried(float(apart / peak), limit.worst(motion).value / peak - 1)


def tried_torque(seed: int) -> Tried:
    """Judge the torques of a random motion of a random arm with random masses."""
    rng = np.random.default_rng([10, seed])
    joints = int(rng.integers(1, 8))
    chain = _loaded(rng, drawn_chain(rng, joints))
    motion = _motion(rng, joints)
    limit = Torque.read(rng.uniform(20, 200, joints).tolist(), joints).for_chain(chain)
    assert isinstance(limit, Torque)
    masses = chain.known_masses("masses", None)
    shares = np.linspace(_AT_ENDS, 1 - _AT_ENDS, _SAMPLES // len(motion.lengths))
    times = np.ravel(motion.breaks[:-1, None] + shares * motion.lengths[:, None])
    uses = limit.along(motion, times)
    peak = max(float(own.max()) for own in uses.values())
    apart = 0.0
    for at in times[:: _SAMPLES // _COMPARED]:
        q, v, a = (motion(at, order) for order in range(3))
        expected = torques(chain, q, v, a) + masses.damping * v
        expected += masses.friction * np.sign(v)
        own = np.array([float(limit.along(motion, np.array([at]))[k][0]) for k in range(joints)])
        apart = max(apart, np.abs(np.abs(expected) / limit.column("torque") - own).max())
    return Tried(float(apart / peak), limit.worst(motion).value / peak - 1)


def _loaded(rng: np.random.Generator, chain: LinkChain) -> LinkChain:
    """Give the links random masses, and the drives friction."""
    bodies = []
    for _ in range(chain.joints):
        points = rng.normal(size=(3, 6)) * 0.1
        spread = points @ points.T
        inertia = np.trace(spread) * np.eye(3) - spread
        centre = rng.uniform(-0.2, 0.2, 3)
        numbers = inertia[np.triu_indices(3)].tolist()
        bodies.append(body(float(rng.uniform(0.1, 5)), centre.tolist(), numbers))
    damping = rng.choice([0.0, 1.0], chain.joints)
    friction = rng.choice([0.0, 1.0], chain.joints, p=[0.8, 0.2])
    unknown = np.full(chain.joints, np.nan)
    return replace(chain, masses=Masses(np.array(bodies), damping, friction, unknown))


def torques(chain: LinkChain, q: Array, v: Array, a: Array) -> Array:
    """Return Pinocchio's torques without friction, N m, `(joints,)`."""
    import pinocchio

    model, _ = _model(chain)
    for joint, own in enumerate(chain.known_masses("masses", None).bodies):
        mass, *numbers = described(own)
        tensor = np.zeros((3, 3))
        tensor[np.triu_indices(3)] = numbers[3:]
        tensor += tensor.T - np.diag(tensor.diagonal())
        inertia = pinocchio.Inertia(mass, np.array(numbers[:3]), tensor)
        model.appendBodyToJoint(joint + 1, inertia, pinocchio.SE3.Identity())
    return np.asarray(pinocchio.rnea(model, model.createData(), q, v, a))


def drawn_chain(rng: np.random.Generator, joints: int) -> LinkChain:
    """Return an arm of joints about or along any axes, one in five of which slides."""
    axes = rng.normal(size=(joints, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    axes[rng.random(joints) < 0.4] = [0.0, 0.0, 1.0]
    turns = rng.choice([0.0, np.pi / 2, 1.0], (joints, 3)) * rng.choice([-1, 1], (joints, 3))
    origins = origin_poses(rng.uniform(-0.5, 0.5, (joints, 3)), turns)
    tool = origin_poses(rng.uniform(-0.3, 0.3, 3), rng.normal(size=3))
    return LinkChain(origins, axes, rng.random(joints) < 0.2, tool)


def _motion(rng: np.random.Generator, joints: int) -> Trajectory:
    breaks = np.append(0.0, np.cumsum(rng.uniform(0.2, 1.0, 4)))
    coefficients = 0.5 * rng.normal(size=(int(rng.choice([4, 6])), 4, joints))
    return Trajectory(breaks, coefficients, breaks[[0, -1]])


def _model(chain: LinkChain, points: Sequence[LinkPoint] = ()) -> tuple[Any, list[int]]:
    """Return Pinocchio's model of a chain, and its frames of points."""
    import pinocchio

    model = pinocchio.Model()
    parent = 0
    for joint, (origin, axis, slides) in enumerate(
        zip(chain.origins, chain.axes, chain.slides, strict=True)
    ):
        kinds = pinocchio.JointModelPrismaticUnaligned, pinocchio.JointModelRevoluteUnaligned
        moves = kinds[0 if slides else 1](*axis)
        parent = model.addJoint(parent, moves, pinocchio.SE3(origin), f"joint {joint}")
    kind = pinocchio.FrameType.OP_FRAME
    frames = []
    for number, point in enumerate(points):
        pose = pinocchio.SE3(np.eye(3), point.place)
        own = pinocchio.Frame(f"point {number}", point.joint + 1, 0, pose, kind)
        frames.append(model.addFrame(own))
    return model, frames


def _speeds(
    chain: LinkChain, motion: Trajectory, times: Array, points: Sequence[LinkPoint]
) -> Array:
    """Return the speeds of points, m/s, `(points, times)`."""
    import pinocchio

    model, frames = _model(chain, points)
    data = model.createData()
    found = np.zeros((len(points), len(times)))
    for column, (q, v) in enumerate(zip(motion(times), motion(times, 1), strict=True)):
        pinocchio.forwardKinematics(model, data, q, v)
        for row, frame in enumerate(frames):
            speed = pinocchio.getFrameVelocity(model, data, frame).linear
            found[row, column] = np.linalg.norm(speed)
    return found
