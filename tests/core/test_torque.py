"""Torques: against closed forms, Lagrange's equations and Pinocchio, and as files state them."""

from __future__ import annotations

import warnings
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from baselines.along.planner import Along
from baselines.collocation.refined import CollocationRefined
from baselines.lower_bound.planner import Prove
from soaks import arms
from trajopt import Limits, Problem, Trajectory
from trajopt.core import arm_file
from trajopt.core.bodies import Masses, body, described
from trajopt.core.chain import LinkChain
from trajopt.core.dynamics import Dynamics
from trajopt.core.exceptions import FileNote, InvalidInput
from trajopt.core.limits import Torque
from trajopt.formats import arms as arm_limits
from trajopt.formats import urdf
from trajopt.judging.verification import verify
from trajopt.planners.testing_limits import check_limit

G = 9.81


def pendulum(mass=2.0, length=0.5, damping=0.0, friction=0.0, axis=(0.0, -1.0, 0.0)) -> LinkChain:
    """A point mass on a rod that turns about a level axis; at 0 it points sideways."""
    bodies = np.array([body(mass, [length, 0, 0], [0] * 6)])
    masses = Masses(bodies, np.array([damping]), np.array([friction]), np.array([np.nan]))
    return LinkChain([np.eye(4)], [axis], [False], np.eye(4), masses)


def limit(torque, chain: LinkChain) -> Torque:
    found = Torque.read(torque, chain.joints).for_chain(chain)
    assert isinstance(found, Torque)
    return found


def line(q: float, v: float, a: float, length: float) -> Trajectory:
    """One joint with a constant acceleration."""
    return Trajectory([0.0, length], [[[a / 2]], [[v]], [[q]]], [0.0, length])


def test_a_pendulum_is_judged_exactly():
    """At 0 rad, 2 kg on 0.5 m: 9.81 N m of gravity, 0.5 kg m² of inertia."""
    own = limit([15.0], pendulum())
    use = own.worst(line(0.0, 0.0, 2.0, 1e-3))
    assert (use.joint, use.value) == (0, pytest.approx((9.81 + 1.0) / 15, rel=1e-7))
    turning = own.worst(line(-1.0, 1.0, 0.0, 2.0))  # steadily through 0
    assert turning.value == pytest.approx(9.81 / 15, rel=2e-8)
    assert turning.time == pytest.approx(1.0, abs=1e-3)
    # 0.5 a / k² + 9.81 = 15: what is left of the torque decides
    fast = line(0.0, 0.0, 40.0, 1e-6)
    assert own.dilation(own.worst(fast), fast) == pytest.approx((20 / 5.19) ** 0.5, rel=1e-7)


def test_friction_has_the_sign_of_the_velocity():
    """No gravity about an upright axis. From −1 to 1 rad/s with 2 rad/s²: both sides count."""
    own = limit([10.0], pendulum(damping=0.3, friction=0.7, axis=(0.0, 0.0, 1.0)))
    back = line(0.0, -1.0, 2.0, 1.0)
    assert own.worst(back).value == pytest.approx((1.0 + 0.3 + 0.7) / 10, rel=1e-7)
    slow = line(0.0, -1.0, 2.0, 0.5)  # until it stands
    assert own.worst(slow).value == pytest.approx((1.0 - 0.7) / 10, rel=1e-6)
    rest = line(0.3, 0.0, 0.0, 1.0)
    assert own.worst(rest).value == pytest.approx(0, abs=1e-7)


def test_a_slower_motion_may_break_the_limit_again():
    """A joint brakes by its own damping, 3 x − 3 x² N m after a dilation by 1/x.

    At 1 that is nothing. At the 0.7 that its velocity limit asks for it is 0.63, over the 0.5 that
    it may be; below it is again where 3 x (1 − x) = 0.5.
    """
    chain = pendulum(mass=4.0, damping=3.0, axis=(0.0, 0.0, 1.0))
    motion = line(0.0, 1.0, -3.0, 1e-5)
    ends = [[0.0], [float(motion(1e-5)[0])]]
    limits = Limits([0.7], [9.0], torque=[0.5])
    problem = Problem(ends, limits, chain=chain)
    alone = problem.limits.kinds["torque"]
    assert alone.dilation(alone.worst(motion), motion) == pytest.approx(1 / 1.15, rel=0.02)
    found = verify(problem, motion, at_rest=False)
    assert found.dilation == pytest.approx(6 / (3 - 3**0.5), rel=1e-4)
    loose = replace(problem, limits=Limits([0.9], [9.0], torque=[0.5]))
    assert verify(loose, motion, at_rest=False).dilation == pytest.approx(1 / 0.9, rel=1e-7)


def test_two_links_move_as_lagrange_says():
    """Spong, Robot Modeling and Control, section 7.4: rods with masses in their middles."""
    l1, m1, m2, i1, i2 = 0.6, 3.0, 2.0, 0.11, 0.05
    c1, c2 = 0.3, 0.2
    origins = np.tile(np.eye(4), (2, 1, 1))
    origins[1, 0, 3] = l1
    bodies = np.array(
        [body(m1, [c1, 0, 0], [0, 0, 0, i1, 0, i1]), body(m2, [c2, 0, 0], [0, 0, 0, i2, 0, i2])]
    )
    axes = [[0, -1, 0]] * 2  # positive upwards
    own = Dynamics(
        origins, np.array(axes), np.zeros(2, bool), bodies, np.zeros(2), np.array([0, 0, -G])
    )
    rng = np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 2, 9))
    h = m2 * l1 * c2 * np.cos(q[1])
    d11 = m1 * c1**2 + i1 + m2 * (l1**2 + c2**2) + i2 + 2 * h
    d12 = m2 * c2**2 + i2 + h
    d22 = m2 * c2**2 + i2
    bend = -m2 * l1 * c2 * np.sin(q[1])
    second = m2 * c2 * G * np.cos(q[0] + q[1])
    first = (m1 * c1 + m2 * l1) * G * np.cos(q[0]) + second
    expected = [
        d11 * a[0] + d12 * a[1] + bend * (2 * v[0] * v[1] + v[1] ** 2) + first,
        d12 * a[0] + d22 * a[1] - bend * v[0] ** 2 + second,
    ]
    np.testing.assert_allclose(own.forces(list(q), list(v), list(a)), expected, rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_random_arms_take_the_torques_of_pinocchio(seed):
    """Turning and sliding joints about any axes: torques everywhere, and their peak."""
    apart, above = arms.tried_torque(seed)
    assert apart < 1e-12
    assert -1e-12 <= above < 1e-5


@pytest.mark.parametrize("name", [n for n in arm_file.arm_files() if arm_file.read(n).chain])
def test_built_in_robots_have_masses_or_say_so(name):
    arm = arm_file.read(name)
    joints = arm.chain.joints
    if arm.chain.masses is None:
        with pytest.raises(InvalidInput, match="an arm whose masses are known"):
            limit(True, arm.chain)
        return
    own = limit("60 %", arm.chain)
    np.testing.assert_allclose(own.column("torque"), 0.6 * arm.chain.masses.effort)
    assert arm.dynamics_origin.source
    rng = np.random.default_rng(2)
    q, v, a = rng.normal(size=(3, joints))
    found = own.dynamics.forces(list(q), list(v), list(a)) - own.column("damping") * v
    expected = arms.torques(arm.chain, q, v, a)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())
    stated = arm_limits.named(name)
    unreal = name == "franka-panda"  # its maker's fourth link
    with pytest.warns(FileNote, match="behind panda_joint4$") if unreal else nullcontext():
        again = replace(stated, stated={"torque": "60 %"}).limits(arm.joint_names)
    np.testing.assert_allclose(again.kinds["torque"].numbers, own.numbers, atol=1e-15)


@pytest.mark.long
def test_one_joint_with_gravity_takes_its_bang_bang():
    """All torque forwards, then backwards: the energy is known at every angle."""
    torque, inertia, load, goal = 15.0, 0.5, 9.81, 2.0
    problem = Problem([[0.0], [goal]], Limits([100.0], [1000.0], torque=[torque]), chain=pendulum())

    def speed(q):
        forwards = torque * q - load * np.sin(q)
        backwards = torque * (goal - q) + load * (np.sin(goal) - np.sin(q))
        return np.sqrt(2 * min(forwards, backwards) / inertia)

    switch = (torque * goal + load * np.sin(goal)) / (2 * torque)
    # dq = 2 u du takes the roots at both ends out of the quadrature
    first, _ = quad(lambda u: 2 * u / speed(u * u), 0, switch**0.5, epsrel=1e-11)
    last, _ = quad(lambda u: 2 * u / speed(goal - u * u), 0, (goal - switch) ** 0.5, epsrel=1e-11)
    path = Along(accuracy=1e-6).solve(problem).trajectory
    found = verify(problem, path).certified_duration
    assert first + last <= found * (1 + 1e-8)
    assert found == pytest.approx(first + last, rel=1e-6)
    refined = verify(problem, CollocationRefined().solve(problem).trajectory).certified_duration
    assert first + last <= refined * (1 + 1e-8)
    assert refined == pytest.approx(first + last, rel=1e-4)
    assert Prove().solve(problem).lower_bound <= found


def test_gravity_alone_may_break_a_limit():
    """Through the level pose, where 9.81 N m hold the mass, with 9 N m; it rests where it may."""
    limits = Limits([3.0], [3.0], torque=[9.0])
    problem = Problem([[-1.0], [1.0]], limits, chain=pendulum())
    free = Problem([[-1.0], [1.0]], Limits([3.0], [3.0]))
    motion = Along().solve(free).trajectory
    certificate = verify(problem, motion)
    (flaw,) = certificate.flaws
    assert flaw.startswith("joint 1 at ")
    assert flaw.endswith("holds 9.81 N m against gravity, its limit is 9 N m")
    with pytest.raises(InvalidInput) as caught:
        Problem([[-1.0], [0.0]], limits, chain=pendulum())
    assert str(caught.value) == (
        "limits.torque, joint 1 is 9.0: expected at least 9.81 N m, by which joint 1 holds the arm "
        "at rest at waypoint 2"
    )


def test_a_limit_keeps_its_numbers():
    own = limit([15.0], pendulum(damping=1.0, friction=0.5))
    check_limit(own)
    stated = body(2.0, [0.1, 0.2, 0.3], [0.1, 0.01, 0.02, 0.11, 0.03, 0.12])
    np.testing.assert_allclose(
        described(stated), [2, 0.1, 0.2, 0.3, 0.1, 0.01, 0.02, 0.11, 0.03, 0.12], atol=1e-15
    )
    assert not Torque.read([np.inf, np.inf], 2).bounds.any()
    some = limit([np.inf, *[30.0] * 5], arm_file.read("ur5e").chain)
    assert some.bounds.tolist() == [False] + [True] * 5
    np.testing.assert_array_equal(Torque.read(some.table(), 6).numbers, some.numbers)
    assert some.table()["torque"][0] == np.inf
    # what stores write for a joint without a limit is NaN
    assert np.isnan(some.numbers).sum() == 1


# --- files ---

FILE = """name = "arm"
robot = "ur5e"
units = {waypoints = "rad", limits = "rad"}
waypoints = [[0, -1.2, 1.3, -1.6, -1.57, 0], [0.5, -1.0, 1.0, -1.5, -1.4, 0.3]]
limits.torque = true
"""


def read(tmp_path, text: str) -> Problem:
    file = tmp_path / "arm.toml"
    file.write_text(text, encoding="utf-8")
    return Problem.from_toml(file)


def test_a_file_states_torques_and_a_payload(tmp_path):
    problem = read(tmp_path, FILE)
    own = problem.limits.kinds["torque"]
    assert own.column("torque").tolist() == [150, 150, 150, 28, 28, 28]
    again = read(tmp_path, problem.to_toml())
    assert again.digest() == problem.digest()
    loaded = read(tmp_path, FILE + "payload = {mass = 5, centre = [0, 0, 0.1]}\n")
    held = [p.limits.kinds["torque"].held(p.waypoints[0]) for p in (problem, loaded)]
    # the payload's own moment about the second joint, by where it is
    tool = problem.chain.forward(problem.waypoints[0])
    place = (tool @ [0, 0, 0.1, 1])[:3]
    shoulder = problem.chain.frames(problem.waypoints[0])[1]
    arm = place - shoulder[:3, 3]
    moment = np.cross(arm, [0, 0, 5 * G]) @ shoulder[:3, 2]
    assert held[1][1] - held[0][1] == pytest.approx(moment, rel=1e-12)
    shares = read(tmp_path, FILE.replace("true", '"60 %"')).limits.kinds["torque"]
    assert shares.column("torque").tolist() == pytest.approx([90, 90, 90, 16.8, 16.8, 16.8])


@pytest.mark.parametrize(
    ("changes", "key", "right"),
    [
        ({"true": "[1, 2]"}, "limits.torque", "6 numbers, N m, one per joint"),
        ({"true": "[0, 9, 9, 9, 9, 9]"}, "limits.torque", "a positive number"),
        ({"true": "[-5, 9, 9, 9, 9, 9]"}, "limits.torque", "a positive number"),
        ({"true": '"much"'}, "limits.torque", "a share as in '60 %'"),
        ({"true": '"10 %"'}, "limits.torque", "holds the arm at rest at waypoint"),
        ({'"ur5e"': '"abb-irb-120"'}, "limits.torque", "an arm whose masses are known"),
        ({"true\n": "true\npayload.mass = 6\n"}, "payload.mass", "at most 5 kg"),
        ({"true\n": "true\npayload.centre = [0, 0, 0]\n"}, "payload.mass", "it is missing"),
        ({"true\n": "true\npayload = 6\n"}, "payload", "a table with mass, centre, inertia"),
        (
            {"true\n": "true\npayload = {mass = 1, inertia = [-1, 0, 0, 1, 0, 1]}\n"},
            "payload.inertia",
            "principal moments from 0 on",
        ),
        ({"true\n": "true\ndynamics.mass = [1]\n"}, "dynamics.centre", "it is missing"),
    ],
)
def test_a_file_that_is_wrong_gets_a_line(tmp_path, changes, key, right):
    text = FILE
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, text)
    message = str(caught.value)
    assert caught.value.key == key
    assert right in message
    assert "\n" not in message


URDF = """<robot name="r">
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.1 0 0.2" rpy="0.3 0.2 0.1"/><mass value="3"/>
 <inertia ixx="0.02" ixy="0.001" ixz="0.002" iyy="0.03" iyz="0" izz="0.025"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
 <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<link name="hand"><inertial><mass value="0.5"/>
 <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
<link name="finger"><inertial><mass value="0.1"/>
 <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
<joint name="one" type="revolute"><parent link="base"/><child link="upper"/>
 <origin xyz="0 0 0.3" rpy="0.1 0.2 0"/><axis xyz="0 1 0"/><dynamics damping="0.4" friction="0.2"/>
 <limit lower="-3" upper="3" velocity="2" effort="80"/></joint>
<joint name="two" type="prismatic"><parent link="upper"/><child link="fore"/>
 <origin xyz="0.5 0 0" rpy="0 0 1"/><axis xyz="1 0 1"/>
 <limit lower="-3" upper="3" velocity="2" effort="40"/></joint>
<joint name="mount" type="fixed"><parent link="fore"/><child link="hand"/>
 <origin xyz="0.4 0 0" rpy="0 0.5 0"/></joint>
<joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/>
 <origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>
 <limit lower="0" upper="0.1" velocity="1" effort="9"/></joint>
</robot>"""


def of_urdf(tmp_path, text: str = URDF, torque: object = "urdf") -> Torque:
    file = tmp_path / "arm.urdf"
    file.write_text(text, encoding="utf-8")
    found = replace(urdf.read(file).with_acceleration(2.0), stated={"torque": torque})
    return found.limits(["one", "two"]).kinds["torque"]


def test_a_urdf_brings_masses_and_efforts(tmp_path):
    """Links that are fixed, and a finger that stays at 0, count; Pinocchio reads the same file."""
    import pinocchio

    own = of_urdf(tmp_path)
    assert own.column("torque").tolist() == [80, 40]
    model = pinocchio.buildModelFromXML(URDF)
    q, v, a = np.random.default_rng(3).normal(size=(3, 3))
    q[2] = v[2] = a[2] = 0
    expected = pinocchio.rnea(model, model.createData(), q, v, a)[:2]
    found = np.subtract(own.dynamics.forces(*(list(x[:2]) for x in (q, v, a))), [0.4 * v[0], 0])
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert own.column("friction").tolist() == [0.2, 0]


def test_an_inertia_that_no_body_has_gets_a_line_where_it_counts(tmp_path):
    """9 % above the sum of the other two, as the Panda's fourth link: no rounding, no refusal."""
    for izz, said in ((0.0495, 0), (0.0545, 1)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            of_urdf(tmp_path, URDF.replace('izz="0.025"', f'izz="{izz}"'))
            urdf.read(tmp_path / "arm.urdf").with_acceleration(2.0).limits(["one", "two"])
        assert len(caught) == said
        assert all("as no body has it; behind one" in str(own.message) for own in caught)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('ixx="0.02"', 'ixx="-0.02"', "link upper, inertial: inertia is [-0.02"),
        ('ixx="0.02"', 'ixx="0.2"', "link upper, inertial: inertia is [0.02"),
        ('<mass value="3"/>', "", "link upper, inertial: mass: expected <mass"),
        ('<mass value="3"/>', '<mass value="-3"/>', "link upper, inertial: mass is -3"),
        ('damping="0.4"', 'damping="-1"', "one: dynamics damping is -1"),
        ('effort="40"', 'effort="0"', "limits.torque, joint 2 is '100 %': expected a number"),
        ("inertial", "visual", "mass behind two is 0: expected a link with a mass"),
    ],
)
def test_a_urdf_without_sound_masses_gets_a_line(tmp_path, old, new, words):
    """Only where torques are limited."""
    text = URDF.replace(old, new)
    with pytest.raises(InvalidInput) as caught:
        of_urdf(tmp_path, text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert urdf.read(tmp_path / "arm.urdf").with_acceleration(2.0).limits(["one", "two"])
