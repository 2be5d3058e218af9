from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ._native import View


@dataclass(frozen=True, eq=False)
class MoveTo:
    """Move to a configuration, straight in joint space: a transaction with one outcome.

    Beyond the limits it is refused. When it comes too near to something, the controller rolls it back, and the robot rests where it began.

    Attributes
    ----------
    q : array (dof,), or (k,) with `joints`
        Positions, rad or m.
    speed : float
        Share of each joint's greatest speed, above 0 and up to 1.
    joints : sequence of str, optional
        Names of the k joints that move; default: all.
    """

    q: ArrayLike
    speed: float = 0.1
    joints: Sequence[str] | None = None


@dataclass(frozen=True, eq=False)
class Stream:
    """Setpoints. `Agent.next` opens a motion with the first, `Agent.revise` continues it with one in each control period.

    When they cease, the robot brakes, and the motion ends where it rests.

    Attributes
    ----------
    position : array (dof,) or (k,), optional
        Positions to follow, rad or m.
    velocity : array (dof,) or (k,), optional
        Velocities, rad/s or m/s. Give one of the two.
    joints : sequence of str, optional
        Names of the k joints; default: all.
    """

    position: ArrayLike | None = None
    velocity: ArrayLike | None = None
    joints: Sequence[str] | None = None


@dataclass(frozen=True)
class Wait:
    """Call `Agent.next` again after some seconds of the run's clock."""

    seconds: float = 0.1


@dataclass(frozen=True)
class Stop:
    """Brake; the motion then ends as failed."""


@dataclass(frozen=True)
class Done:
    """The agent has nothing more to do.

    Attributes
    ----------
    text : str
        A sentence for the summary.
    figures : mapping from str to float
        Named figures for the summary.
    """

    text: str = "done"
    figures: Mapping[str, float] = field(default_factory=dict)


class Agent:
    """Base of agents: code that plans the motions of a robot in a run.

    An agent may ask for infeasible motions: the controller prevents harm, and the agent learns that the motion failed. An exception in one
    of these methods is the agent's death: its motion is rolled back, the traceback is in the journal (``Run.errors``), and supervision calls
    it again as it does any agent that died, with `import_` of the state that it exported last. After several deaths in half a minute it
    stays down, and the run ends.

    All methods are called in the thread that called `mobee.run`, never in one of the controller. In virtual time the run's clock stands
    meanwhile. A real robot goes on; Python code that is slow delays its own motions alone.
    """

    def next(self, last: Literal["reached", "failed"] | None, view: View) -> MoveTo | Stream | Wait | Stop | Done:
        """Chooses the next motion. The robot rests.

        Parameters
        ----------
        last : "reached", "failed" or None
            The end of the last motion; None at the start, after a `Wait`, and where the robot was not ready for it. A motion that was
            rolled back or refused has failed.
        view : View
            The robot, the objects and the contacts at present.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method `next`")

    def revise(self, view: View) -> MoveTo | Stream | Stop | None:
        """Changes the motion under way, or leaves it alone (None).

        Called when an object of the world has changed, and in each control period of a `Stream`.
        """
        return None

    def export(self) -> Any:
        """The state for a successor, as JSON: None, bool, int, float, str, and lists and dicts of them. Called after each `next`."""
        return None

    def import_(self, state: Any) -> None:
        """Takes over what `export` returned last. Called after a death, before `next`."""
