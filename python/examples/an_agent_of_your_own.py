"""An agent in Python: `python an_agent_of_your_own.py explore.toml`. It waves, and turns back wherever a motion fails."""

import sys
from typing import Any, Literal

import numpy as np

import mobee


class Wave(mobee.Agent):
    """Swings the first joint that moves a frame, and goes where its scene says that the way is free."""

    def __init__(self, times: int = 12) -> None:
        self.left = times
        self.failed = 0
        self.avoided = 0

    def next(self, last: Literal["reached", "failed"] | None, view: mobee.View) -> mobee.MoveTo | mobee.Done:
        self.failed += last == "failed"
        if self.left == 0:
            text = f"waved; {self.failed} motions failed and were rolled back, {self.avoided} were avoided"
            return mobee.Done(text, {"failed": self.failed, "avoided": self.avoided})
        self.left -= 1
        robot = view.model
        rng = np.random.default_rng([view.seed, self.left])
        # half of them as they come: the controller prevents harm
        goal = np.clip(view.q + rng.uniform(-0.6, 0.6, robot.dof), robot.lower, robot.upper)
        if self.left % 2 == 0 and not view.scene.edge(np.clip(view.q, robot.lower, robot.upper), goal):
            self.avoided += 1
            goal = robot.home
        return mobee.MoveTo(goal, speed=0.3)

    # for a successor, should this agent die
    def export(self) -> list[int]:
        return [self.left, self.failed, self.avoided]

    def import_(self, state: Any) -> None:
        self.left, self.failed, self.avoided = state


if __name__ == "__main__":
    run = mobee.run(sys.argv[1], agent=Wave(), seed=1, out=sys.argv[2] if len(sys.argv) > 2 else None)
    for event in run.journal.of("outcome"):
        print(f"{event.at:7.2f} s  {event['outcome']:12} {event.get('cause') and next(iter(event['cause']), '')}")
    print(run.summary["counters"]["done"], run.errors)
    print("invariants", "hold:" if run.check() else "BROKEN:", run.check().judged)
    # pandas.DataFrame(run.journal.table("outcome")) is a table of them
    print("folder:", run.folder)
