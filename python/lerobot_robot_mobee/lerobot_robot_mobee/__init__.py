"""A robot of LeRobot that is driven by MoBeE: ``--robot.type=mobee --robot.file=so101.toml``."""

from .robot import Mobee, MobeeConfig

__all__ = ["Mobee", "MobeeConfig"]
