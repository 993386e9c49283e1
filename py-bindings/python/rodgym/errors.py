"""The whole tree of rodgym's exceptions.

Whatever is refused leaves the state as it was. Bad arguments are `ValueError` too, so that code
which knows nothing of rodgym can catch them: a value of the wrong kind is refused like one out of
range. An unknown keyword is a `TypeError` too, in Python's words. Python's own `TypeError` stands
for calls with missing or too many arguments only.
"""

from gymnasium.error import ResetNeeded


class RodgymError(Exception):
    """Everything that rodgym raises."""


class UnknownEnvError(RodgymError, ValueError):
    """No environment of that id."""


class ParameterError(RodgymError, ValueError):
    """An unknown name, or a value outside its range or of the wrong kind."""


class UnknownKeywordError(ParameterError, TypeError):
    """A keyword argument that an environment or simulation does not have."""


class SettingError(RodgymError, AttributeError):
    """An attribute that cannot be set, because that would change nothing."""


class ShapeError(RodgymError, ValueError):
    """An array of the wrong shape or type."""


class ActionError(RodgymError, ValueError):
    """A NaN or infinity among the actions."""


class EnvIndexError(RodgymError, IndexError, ValueError):
    """An environment number beyond the batch."""


class SnapshotError(RodgymError, ValueError):
    """A snapshot that cannot be read, or that belongs to another kind of environment."""


class ResetNeededError(RodgymError, ResetNeeded):
    """A step before the first reset, or after an episode's end while autoreset is off."""


class SolverError(RodgymError, ArithmeticError):
    """The solver could not take a step, even in the smallest parts."""


class DesignError(RodgymError, ValueError):
    """A controller that cannot be designed: a Riccati equation without solution, or too ill
    conditioned for one.
    """


class AccuracyWarning(UserWarning):
    """No default scheme and step keep the motion of such a rod as exact as is promised."""
