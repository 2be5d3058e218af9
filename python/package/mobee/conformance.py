"""The promises of all drivers, checked for a driver in Python by the wall clock.

    import mobee.conformance, pytest

    @pytest.mark.parametrize("promise", mobee.conformance.PROMISES)
    def test_my_arm(promise):
        mobee.conformance.check(MyArm, promise)

The robot moves: up to three motors, each by 8 degrees at up to 10 deg/s, and one to both its limits. Make sure that the path is free.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from ._driver import Driver, start
from ._error import MobeeError
from ._native import keep_promise, promises

__all__ = ["PROMISES", "check"]

#: The names of all promises.
PROMISES: tuple[str, ...] = tuple(promises())

# threads that wake up later than this make a failed attempt worthless, s
_STALL_S = 0.005


def check(driver: type[Driver] | Callable[[], Driver], promise: str | None = None, *, attempts: int = 5, at_once: int = 1) -> None:
    """Checks the promises of a driver, each with a new object.

    Parameters
    ----------
    driver : class, or function without arguments
        Makes a driver. Each of its axes needs ``lower`` and ``upper``, and two of them some degrees of room.
    promise : str, optional
        One of `PROMISES`; default: all of them.
    attempts : int
        A promise that fails while the machine is too busy for real time is tried again, so often in all.
    at_once : int
        Promises checked at the same time; more than 1 only for drivers of simulated arms.

    Raises
    ------
    MobeeError
        code ``conformance``: the promises that are broken, each with what was seen; ``axes``, ``type``: it is no driver.
    """
    if isinstance(driver, Driver):
        raise MobeeError("type", "driver is an object, and each promise needs a new one", "driver", "give the class")
    if isinstance(promise, str) and promise not in PROMISES:
        raise MobeeError("promise", f"there is no promise {promise!r}", "promise", "give one of mobee.conformance.PROMISES")
    names = PROMISES if promise is None else (promise,)
    one = partial(_attempts, driver, max(1, attempts))
    if at_once <= 1:
        results = [one(name) for name in names]
    else:
        with ThreadPoolExecutor(at_once) as pool:
            results = list(pool.map(one, names))
    broken = [f"{name}: {seen}" for name, (seen, _) in zip(names, results, strict=True) if seen is not None]
    if broken:
        cause = next((cause for _, cause in results if cause is not None), None)
        raise MobeeError("conformance", "\n".join(broken), None, "correct the driver; docs/python.md has its rules") from cause


def _attempts(driver: Callable[[], Driver], attempts: int, promise: str) -> tuple[str | None, BaseException | None]:
    seen: str | None = None
    cause: BaseException | None = None
    for _ in range(attempts):
        serving = start(driver)
        try:
            seen, late = keep_promise(serving.line, promise)
        finally:
            serving.end()
            serving.join()
        cause = serving.error
        if seen is None:
            return None, None
        seen = f"{seen} (threads woke up late by up to {1e3 * late:.1f} ms)"
        if late < _STALL_S:
            break
    return seen, cause
