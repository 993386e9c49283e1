"""Controllers designed for an environment, playing one episode or a batch of them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from rodgym import _native, machines
from rodgym._checks import numbers, refused
from rodgym._layers import changing
from rodgym.errors import ParameterError, ShapeError

State = npt.NDArray[np.float64]
Action = npt.NDArray[np.float32]
Self = TypeVar("Self", bound="Controller")


def describe(env: Any) -> dict[str, Any]:
    """The `core_spec` of an environment whose wrappers leave observations and actions as they are.

    Raises:
        ParameterError: not an environment of rodgym, or one behind wrappers that change them.
    """
    spec = machines.spec_of(env)
    named = changing(env)
    for what in ("observation", "action"):
        space = getattr(env, f"single_{what}_space", None) or getattr(env, f"{what}_space", None)
        if named or (space is not None and what in spec and not _is(space, spec[what])):
            behind = f" behind {' and '.join(named)}" if named else ""
            raise ParameterError(
                f"{what}_space = {space}{behind} is not allowed: it must be the one that rodgym "
                "defines, for a controller takes its numbers for what rodgym says they are"
            )
    return spec


def _is(space: Any, own: dict[str, Any]) -> bool:
    """Whether a space has the bounds that the core defines."""
    return all(
        np.array_equal(getattr(space, side, np.nan), np.asarray(own[side], np.float32))
        for side in ("low", "high")
    )


class Controller:
    """A control law with the `predict` of a Stable-Baselines3 policy.

    The law has no memory of its own: what it knows of an episode (a clock, an estimate) is the
    `state` that `predict` returns and takes again.
    """

    #: Name in `CONTROLLERS`, set by each law.
    name: ClassVar[str]
    #: What tables call it; empty: its name.
    title: ClassVar[str] = ""
    #: Whether it is found by playing the environment as that draws its parameters.
    plays: ClassVar[bool] = False
    #: Whether it learns its machine: what an environment draws is then what it believes possible.
    learns: ClassVar[bool] = False

    def __init__(self, spec: dict[str, Any]) -> None:
        """Designs the law for an environment's `core_spec` (see `for_env`)."""
        self._native = _native.Controller(self.name, spec)

    @classmethod
    def for_env(cls: type[Self], env: Any) -> Self:
        """Designs the law for an environment, a vector environment or an SB3 `VecEnv`.

        That is for its nominal parameters, where it draws some.

        Raises:
            ParameterError: not an environment that this law can play.
            DesignError: the design has no solution.
        """
        return cls(describe(env))

    @property
    def config(self) -> dict[str, Any]:
        """Keywords of the environment it was designed for."""
        return self._native.config

    @property
    def design(self) -> dict[str, Any]:
        """Physical parameters that it was designed for, by keyword: values, or the range from which
        they were drawn when it was found by playing.
        """
        values = {name: self.config[name] for name in self._native.physical}
        return {**values, **(self.config.get("randomize") or {})} if self.plays else values

    @property
    def parameters(self) -> dict[str, float]:
        """What the design settled on, by name.

        Of a regulator the weights of its cost on angles [1/rad^2], rates [s^2/rad^2] and torque
        [1/(N m)^2], and the most torque that it asks for [N m] or the thesis' swing-up [N m, rad/s]
        and its switch [rad]; of a filter the standard deviations that it believes of base angle
        [rad] and rate [rad/s], and the variances that it adds to every coordinate and rate at each
        step; of a gait `amplitude` (of the action), `frequency` [Hz] and `found_return` (mean of
        the search).
        """
        return self._native.parameters

    def fits(self, env: Any) -> None:
        """Refuses an environment that shows or takes other numbers than those of the design.

        Raises:
            ParameterError: wrappers that change them, or another observation.
        """
        size = len(describe(env)["observation"]["names"])
        if size != self._native.observation_size:
            raise ParameterError(
                f"{self!r} needs observations of {self._native.observation_size} numbers, but this "
                f"environment shows {size}"
            )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes every number of the design to a file: for `load`, and for programs in C
        (docs/motor.md).

        Raises:
            ParameterError: a controller of another package, which cannot be saved.
        """
        path = Path(path)
        path.write_bytes(self._native.save())
        return path

    @property
    def state_size(self) -> int:
        """Numbers that it remembers of an episode."""
        return self._native.state_size

    def predict(
        self,
        observation: npt.ArrayLike,
        state: State | None = None,
        episode_start: npt.ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[Action, State]:
        """Actions for one observation or a batch.

        Arguments:
            observation: (d,) or (n, d), as the environment returns it.
            state: what the last call returned, (n, state_size); None starts every episode.
            episode_start: (n,) flags of episodes that begin with this observation.
            deterministic: for the sake of the signature; the laws draw nothing.

        Returns:
            Actions (1,) or (n, 1) in [-1, 1], float32, and the next state.

        Raises:
            ShapeError: arrays that do not belong together. The state given is never changed.
        """
        array = numbers("observation", observation, np.float32)
        if array.ndim not in (1, 2):
            raise ShapeError(f"observation has shape {array.shape}, but (d,) or (n, d) is needed")
        rows = np.atleast_2d(array)
        n = rows.shape[0]
        if state is None:
            state = np.zeros((n, self._native.state_size))
            start = np.ones(n, dtype=bool)
        elif episode_start is None:
            start = np.zeros(n, dtype=bool)
        else:
            start = np.atleast_1d(np.asarray(episode_start, dtype=bool))
        memory = numbers("state", state)
        if start.shape != (n,) or memory.shape != (n, self._native.state_size):
            raise ShapeError(
                f"state has shape {memory.shape} and episode_start {start.shape}, but "
                f"{(n, self._native.state_size)} and {(n,)} are needed"
            )
        action, memory = self._native.predict(rows, memory, start)
        return (action[0] if array.ndim == 1 else action), memory

    def __repr__(self) -> str:
        made_for = ", ".join(
            f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}"
            for name, value in self.design.items()
        )
        return f"{type(self).__name__}({made_for})"


class _Learner(Controller):
    """A law that finds out what its machine is like while it moves it."""

    learns = True

    def estimate(self, state: State) -> dict[str, npt.NDArray[np.float64]]:
        """What it has found out.

        Arguments:
            state: what `predict` returned last, (n, state_size).

        Returns:
            By name an array (n, 3): best value, and the ends of the interval that holds the truth
            in nine of ten episodes.
        """
        told = self._native.estimate(np.atleast_2d(numbers("state", state)))
        return {name: values for name, (_, values) in told.items()}


class Lqr(Controller):
    """State feedback that swings up and balances: a sampled regulator with a large basin.

    Where it does not bring the rod up, it pumps energy until it can. Needs observation="full".
    """

    name = "lqr"
    title = "LQR"


class HybridLqr(Controller):
    """The thesis' hybrid, sampled: its weights, its open-loop swing-up, its 60 degree switch.

    Needs observation="full".
    """

    name = "lqr-hybrid"
    title = "hybrid LQR"


class Lqg(Controller):
    """Output feedback: an extended Kalman filter of order 12 at most, and the regulator of `Lqr`.

    Sees base angle and rate only (observation="base"), of rods with any number of nodes. An
    observation that is NaN is a lost sample. It knows the `actuator_delay` that the environment
    declares.
    """

    name = "lqg"
    title = "LQG"


class LqgAdaptive(_Learner):
    """Output feedback of a rod that is only roughly known: eight filters that learn it.

    The rods that it believes possible are those that the environment draws (`randomize`); where it
    draws none, those about the nominal one. Of these it learns stiffness and mass. Sees what `Lqg`
    sees.

    `estimate` tells `bending_stiffness` E I [N m^2] and `mass` [kg], and `youngs_modulus` [Pa] and
    `width` [m] where the density is known.
    """

    name = "lqg-adaptive"
    title = "adaptive LQG"


class Mpc(Controller):
    """Predictive control: at every step it betters a plan of the next 1.5 s and takes its first
    action, within the motor's limits.

    Plans are made on the model of `Lqg`, by iterated regulators on what the swing-up pays, and
    begin with the last plan or with what `Lqr` would do. Sees every edge (observation="full"), or
    base angle and rate only (observation="base"): then the filter of `Lqg` says where the rod is.
    """

    name = "mpc"
    title = "MPC"


class ThesisLqr(Controller):
    """The thesis' continuous gain, sampled and held: what becomes of it on a real motor.

    Inside the implicit step it works (`rodgym.baselines.thesis_run`); held for a control period it
    does not. Needs observation="full".
    """

    name = "thesis-lqr"
    title = "thesis LQR"


class ThesisLqg(Controller):
    """The thesis' observer and gain with the torque held. Sees the base edge only."""

    name = "thesis-lqg"
    title = "thesis LQG"


class Gait(Controller):
    """A periodic pitch command for the fin, the best of its waveform.

    Amplitude and frequency are found by playing the environment with all its limits: a grid, then
    two finer grids about the best point, over the same eight episodes for every candidate (seeds
    0 to 7, a few seconds). They are in `parameters`.
    """

    name = "gait"
    title = "best gait"
    plays = True

    @classmethod
    def for_env(cls, env: Any, waveform: str | None = None) -> Gait:
        """The best gait for an environment of the fin.

        Arguments:
            env: an environment, a vector environment or an SB3 `VecEnv`.
            waveform: `"sine"`, `"square"` (a squared sine), `"triangle"`; `None`: the best of them.
        """
        laws = {None: cls, "sine": SineGait, "square": SquareGait, "triangle": TriangleGait}
        if waveform not in laws:
            known = ", ".join(repr(name) for name in laws)
            raise refused("waveform", waveform, f"one of {known}")
        return laws[waveform](describe(env))


class SineGait(Gait):
    """A sinusoid."""

    name = "gait-sine"
    title = "sine"


class SquareGait(Gait):
    """A squared sine, tanh(2 sin) / tanh 2: it lingers at its ends."""

    name = "gait-square"
    title = "squared sine"


class TriangleGait(Gait):
    """A triangle with slightly rounded corners: constant rate."""

    name = "gait-triangle"
    title = "triangle"


class AdaptiveGait(_Learner):
    """A sinusoid whose frequency and amplitude follow the stiffness that is felt.

    The stiffnesses that it believes possible are those that the environment draws (`randomize`);
    where it draws none, 0.3 to 3 times the nominal one. What fins of each feel like, and which gait
    suits them, it learns by playing the environment (some ten seconds). It feels pitch, torque and
    thrust (observation="full").

    `estimate` tells `youngs_modulus` [Pa].
    """

    name = "gait-adaptive"
    title = "adaptive gait"
    plays = True


#: Laws that have a class of their own; any other of the core is a plain `Controller`.
_LAWS: tuple[type[Controller], ...] = (
    Lqr,
    HybridLqr,
    Lqg,
    LqgAdaptive,
    Mpc,
    ThesisLqr,
    ThesisLqg,
    Gait,
    SineGait,
    SquareGait,
    TriangleGait,
    AdaptiveGait,
)


def _controllers() -> dict[str, type[Controller]]:
    laws = {law.name: law for law in _LAWS}
    return {
        name: laws.get(name) or type(name, (Controller,), {"name": name})
        for name, _ in _native.controllers()
    }


#: Controllers by the name that the command line uses, in the order of the core's table.
CONTROLLERS: dict[str, type[Controller]] = _controllers()


def make(name: str, env: Any) -> Controller:
    """The controller of this name, designed for an environment."""
    if name not in CONTROLLERS:
        raise refused("controller", name, f"one of {', '.join(CONTROLLERS)}")
    return CONTROLLERS[name].for_env(env)


def load(path: str | os.PathLike[str]) -> Controller:
    """The controller of a file that `Controller.save` wrote; it takes the same bits.

    Raises:
        SnapshotError: not such a file, or one of another version.
    """
    native = _native.Controller.load(Path(path).read_bytes())
    law = CONTROLLERS[native.name]
    controller = law.__new__(law)
    controller._native = native
    return controller
