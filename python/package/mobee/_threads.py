from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import iterate
from numpy.typing import NDArray

_Array = NDArray[np.float32]
_Env = gymnasium.Env[_Array, _Array]


class _Ahead(gymnasium.Wrapper[_Array, _Array, _Array, _Array]):
    """An environment whose next results were computed already, in another thread."""

    def __init__(self, env: _Env) -> None:
        super().__init__(env)
        self.steps: deque[Any] = deque()
        self.resets: deque[Any] = deque()

    def step(self, action: Any) -> Any:
        return self.steps.popleft() if self.steps else self.env.step(action)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        return self.resets.popleft() if self.resets else self.env.reset(seed=seed, options=options)

    def step_ahead(self, action: Any, reset_at_end: bool) -> None:
        result = self.env.step(action)
        self.steps.append(result)
        if reset_at_end and (result[2] or result[3]):
            self.resets.append(self.env.reset())

    def reset_ahead(self, seed: int | None, options: dict[str, Any] | None) -> None:
        self.resets.append(self.env.reset(seed=seed, options=options))


class ThreadVectorEnv(SyncVectorEnv):
    """A `gymnasium.vector.SyncVectorEnv` whose environments step, and are reset, in threads at the same time."""

    def __init__(self, env_fns: Sequence[Callable[[], _Env]], autoreset_mode: AutoresetMode | str) -> None:
        self._pool = ThreadPoolExecutor(len(env_fns), "mobee-gym")
        futures = [self._pool.submit(make) for make in env_fns]
        try:
            self._all(futures)
        except BaseException:
            for future in futures:
                if not future.exception():
                    future.result().close()
            self._pool.shutdown()
            raise
        envs = [_Ahead(future.result()) for future in futures]
        super().__init__([lambda env=env: env for env in envs], autoreset_mode=autoreset_mode)  # type: ignore[misc]
        self._ahead = envs

    @staticmethod
    def _all(futures: Sequence[Future[Any]]) -> None:
        """Waits for all, also after Ctrl-C; raises the first exception."""
        try:
            wait(futures)
        finally:
            wait(futures)
        for future in futures:
            future.result()

    def _compute(self, futures: Sequence[Future[Any]]) -> None:
        try:
            self._all(futures)
        except BaseException:
            for env in self._ahead:
                env.steps.clear()
                env.resets.clear()
            raise

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        if seed is None or isinstance(seed, int):
            seeds = [None if seed is None else seed + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        rest = None if options is None else {name: value for name, value in options.items() if name != "reset_mask"}
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_))
        # what is malformed, gymnasium refuses
        if len(seeds) == self.num_envs and isinstance(mask, np.ndarray) and mask.shape == (self.num_envs,):
            chosen = [(env, own) for env, own, reset in zip(self._ahead, seeds, mask, strict=True) if reset]
            self._compute([self._pool.submit(env.reset_ahead, own, rest) for env, own in chosen])
        return super().reset(seed=seed, options=options)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        futures: list[Future[Any]] = []
        every = list(iterate(self.action_space, actions))
        for env, action, over in zip(self._ahead, every, self._autoreset_envs, strict=True):
            if over and self.autoreset_mode == AutoresetMode.NEXT_STEP:
                futures.append(self._pool.submit(env.reset_ahead, None, None))
            elif not (over and self.autoreset_mode == AutoresetMode.DISABLED):
                futures.append(self._pool.submit(env.step_ahead, action, self.autoreset_mode == AutoresetMode.SAME_STEP))
        self._compute(futures)
        return super().step(actions)

    def close_extras(self, **kwargs: Any) -> None:
        """Closes the environments and ends the threads."""
        super().close_extras(**kwargs)
        self._pool.shutdown()
