"""Cases of other simulators, each where it is installed.

The plant is the pendulum of Table 4.1 and a step is 10 ms, unless the name says another task. They
are timed without observation, reward and reset, which only favours them.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from rodgym.bench import mujoco_models
from rodgym.bench.measure import Case
from rodgym.extras import installed

CONTROL_DT = 0.01
TORQUE_LIMIT = 0.05
#: What all ratios are taken to.
BEST_MUJOCO = "MuJoCo chain, RK4 5 ms"
#: MuJoCo: name, model, integrator, step [s].
MUJOCO = (
    (BEST_MUJOCO, mujoco_models.chain, "RK4", 5e-3),
    ("MuJoCo chain, RK4 2 ms", mujoco_models.chain, "RK4", 2e-3),
    ("MuJoCo chain, implicitfast 2 ms", mujoco_models.chain, "implicitfast", 2e-3),
    ("MuJoCo flex, Euler 0.1 ms", mujoco_models.flex, "Euler", 1e-4),
)


def peers() -> Iterator[Case]:
    """Every installed peer; one that fails to start is named with its reason, not hidden."""
    if installed("mujoco"):
        for name, model, integrator, dt in MUJOCO:
            yield mujoco(name, model(integrator, dt))
    yield gymnasium_pendulum()
    others: tuple[tuple[str, Callable[[], Case]], ...] = (
        ("envpool", envpool_pendulum),
        ("elastica", elastica_pendulum),
        ("gym_softrobot", softrobot_pendulum),
    )
    for module, make in others:
        if installed(module):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    yield make()
            except Exception as error:  # a peer of another age must not end our run
                print(f"  {module} is installed but did not start: {error!r}")


def mujoco(name: str, xml: str, torque_limit: float = TORQUE_LIMIT) -> Case:
    """One MuJoCo model in a loop, all physics steps of a control step in one call.

    The name says so if the model diverges under such torques (MuJoCo then resets it and goes on).
    """
    import mujoco as mj

    warned: list[object] = []
    mj.set_mju_user_warning(warned.append)

    model = mj.MjModel.from_xml_string(xml)
    data = mj.MjData(model)
    steps = round(CONTROL_DT / model.opt.timestep)
    torques = np.random.default_rng(0).uniform(-torque_limit, torque_limit, 997)

    def run(count: int) -> None:
        # Episodes of 500 steps, as ours.
        for i in range(count):
            if i % 500 == 0:
                mj.mj_resetData(model, data)
            if model.nu:
                data.ctrl[0] = torques[i % 997]
            mj.mj_step(model, data, steps)

    if steps <= 10:
        run(2000)
    return Case(name + (", diverges at times" if warned else ""), 1, run)


def gymnasium_pendulum() -> Case:
    """A rigid pendulum in NumPy, one environment after the other in Python."""
    import gymnasium as gym

    n = 64
    env = gym.make_vec("Pendulum-v1", num_envs=n, vectorization_mode="sync")
    env.reset(seed=0)
    action = np.random.default_rng(0).uniform(-2, 2, (n, 1)).astype(np.float32)

    def run(count: int) -> None:
        for _ in range(count):
            env.step(action)

    return Case(f"Gymnasium SyncVectorEnv Pendulum-v1 (rigid), n = {n}", n, run)


def envpool_pendulum() -> Case:
    """A rigid pendulum in C++: the cost of a vector interface with next to no physics."""
    import envpool

    n = 256
    env: Any = envpool.make_gymnasium("Pendulum-v1", num_envs=n, num_threads=2)
    env.reset()
    action = np.random.default_rng(0).uniform(-2, 2, (n, 1)).astype(np.float32)

    def run(count: int) -> None:
        for _ in range(count):
            env.step(action)

    return Case(f"EnvPool Pendulum-v1 (rigid), n = {n}, 2 threads", n, run, alone=False)


def elastica_pendulum() -> Case:
    """A Cosserat rod of 6 elements, pinned, at the largest step that stays stable (8e-5 s)."""
    import elastica as ea

    class System(ea.BaseSystemCollection, ea.Constraints, ea.Forcing):
        pass

    dt = 8e-5
    system = System()
    rod = ea.CosseratRod.straight_rod(
        6,
        np.zeros(3),
        np.array([1.0, 0.0, 0.0]),
        np.array([0.0, 0.0, 1.0]),
        0.3,
        # A round section with the bending stiffness of the square one.
        0.007 / (3.0 * np.pi) ** 0.25 * 2**0.5,
        density=1500.0,
        youngs_modulus=1e7,
        shear_modulus=1e7 / 3.0,
    )
    system.append(rod)
    system.constrain(rod).using(
        ea.GeneralConstraint,
        constrained_position_idx=(0,),
        constrained_director_idx=(0,),
        translational_constraint_selector=np.array([True, True, True]),
        rotational_constraint_selector=np.array([False, False, False]),
    )
    system.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array([0.0, -9.81, 0.0]))
    system.finalize()
    stepper = ea.PositionVerlet()
    substeps = round(CONTROL_DT / dt)
    now = np.float64(0.0)

    def run(count: int) -> None:
        nonlocal now
        for _ in range(count * substeps):
            now = stepper.step(system, now, np.float64(dt))

    run(1)
    assert np.isfinite(rod.position_collection).all(), "the rod of PyElastica blew up"
    return Case("PyElastica, 6 elements, 0.08 ms", 1, run)


def softrobot_pendulum() -> Case:
    """The nearest environment that users have today: another task, 40 ms a step, 50 elements."""
    import gym_softrobot  # noqa: F401
    import gymnasium as gym

    env = gym.make("SoftPendulum-v0").unwrapped
    env.reset(seed=0)

    def run(count: int) -> None:
        for _ in range(count):
            terminated, truncated = env.step(np.zeros(1, dtype=np.float32))[2:4]
            if terminated or truncated:
                env.reset(seed=0)

    return Case("gym-softrobot SoftPendulum-v0 (40 ms a step)", 1, run)
