"""A driver in Python: `python a_driver_of_your_own.py configs/robots/ur5.xml`. Replace `read` and `command` by calls of your hardware.

The motors of this one are simulated: each lags behind its target by 20 ms. The run is by the wall clock, and takes some seconds.
"""

import sys
import tempfile
import time
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

import mobee

LAG_S = 0.02


class MyArm(mobee.Driver):
    """Motors that lag behind their targets."""

    def __init__(self, robot: mobee.Robot) -> None:
        self.axes = [mobee.Axis(name, max_speed=2.0, max_acceleration=8.0) for name in robot.joint_names]
        self.q = self.targets = robot.home
        self.at = time.monotonic()

    def read(self) -> mobee.Sample:
        now = time.monotonic()
        self.q = self.targets + (self.q - self.targets) * np.exp((self.at - now) / LAG_S)
        self.at = now
        return mobee.Sample(self.q)

    def command(self, targets: NDArray[np.float64]) -> None:
        self.targets = targets


class Fold(mobee.Agent):
    """Moves the arm a little, and then folds it into itself."""

    def __init__(self) -> None:
        self.left = [0.3, 2.9, -0.3]

    def next(self, last: Literal["reached", "failed"] | None, view: mobee.View) -> mobee.MoveTo | mobee.Done:
        if not self.left:
            return mobee.Done()
        return mobee.MoveTo([self.left.pop(0)], joints=[view.joint_names[2]], speed=0.4)


if __name__ == "__main__":
    model = Path(sys.argv[1]).resolve()
    out = sys.argv[2] if len(sys.argv) > 2 else None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arm.toml"
        file.write_text(f'[[robot]]\nname = "arm"\nmodel = "{model}"\ncontroller = {{ period_ms = 20, history = 6000, stale_ms = 200 }}\n')
        run = mobee.run(file, agent=Fold(), driver=MyArm(mobee.load(model)), clock="real", for_s=30, out=out)
    for event in run.journal.of("outcome"):
        print(f"{event.at:7.2f} s  {event['outcome']}")
    print("invariants", "hold:" if run.check() else "BROKEN:", run.check().judged)
    print(run.errors, run.warnings)
