"""Does the judge find the peak of a tool's speed, whatever the arm and the motion?

Random arms of turning and sliding joints about any axes, with random motions of cubic and quintic
pieces: the speed is compared with Pinocchio's at samples, the peak with that of dense samples.

    python tests/soak.py arms
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from cyclopts import Parameter

from trajopt.core.arrays import Array
from trajopt.core.chain import LinkChain, origin_poses
from trajopt.core.limits import ToolSpeed
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
    found = [tried(seed) for seed in range(30 if quick else count)]
    apart, above = np.array(found).T
    print(f"{len(found)} arms; speeds differ from Pinocchio's by {apart.max():.1e} at most;")
    print(f"peaks are above those of {_SAMPLES} samples by {above.min():.1e} to {above.max():.1e}")
    if apart.max() > 1e-12 or above.min() < -1e-12:
        raise SystemExit(1)


def tried(seed: int) -> Tried:
    """Judge a random motion of a random arm."""
    rng = np.random.default_rng([9, seed])
    joints = int(rng.integers(1, 8))
    chain = _chain(rng, joints)
    motion = _motion(rng, joints)
    limit = ToolSpeed.read(1.0, joints).for_chain(chain)
    shares = np.linspace(_AT_ENDS, 1 - _AT_ENDS, _SAMPLES // len(motion.lengths))
    times = np.ravel(motion.breaks[:-1, None] + shares * motion.lengths[:, None])
    peak = float(limit.along(motion, times)[None].max())
    at = times[:: _SAMPLES // _COMPARED]
    apart = np.abs(limit.along(motion, at)[None] - _speeds(chain, motion, at)).max()
    return Tried(float(apart / peak), limit.worst(motion).value / peak - 1)


def _chain(rng: np.random.Generator, joints: int) -> LinkChain:
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


def _speeds(chain: LinkChain, motion: Trajectory, times: Array) -> Array:
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
    frame = model.addFrame(pinocchio.Frame("tool", parent, 0, pinocchio.SE3(chain.tool), kind))
    data = model.createData()
    found = []
    for q, v in zip(motion(times), motion(times, 1), strict=True):
        pinocchio.forwardKinematics(model, data, q, v)
        speed = pinocchio.getFrameVelocity(model, data, frame).linear
        found.append(float(np.linalg.norm(speed)))
    return np.array(found)
