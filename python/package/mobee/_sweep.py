from __future__ import annotations

import functools
import importlib
import json
import multiprocessing
import os
import pickle
import signal
import sys
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal, TextIO

import numpy as np

from ._error import MobeeError

_Row = dict[str, Any]
_Rows = Generator[_Row, None, None]
_OWN = ("seed", "ok", "seconds", "error", "traceback")
# width of the progress bar, characters
_BAR = 24
# a process that has been asked to end is killed after this, s
_END_PATIENCE = 2.0
# period of looking at signals, s
_SIGNAL_PERIOD = 0.05


def sweep(
    fn: Callable[[int], Any],
    seeds: Iterable[int],
    *,
    backend: Literal["threads", "processes", "ray"] = "threads",
    workers: int | None = None,
    results: str | PathLike[str] | None = None,
    retry: bool = False,
    progress: bool | Callable[[int, int], object] | None = None,
) -> list[dict[str, Any]]:
    """Calls a function for each seed, spread over threads, processes or a Ray cluster.

    Parameters
    ----------
    fn : callable
        Called as ``fn(seed)``. Returns a dict of numbers, texts, lists and dicts, or one of these, which becomes ``value``.
    seeds : iterable of int
        Each once.
    backend : "threads", "processes" or "ray"
        ``threads``: for functions that wait for `mobee.run`, queries or plans, which release the interpreter's lock. ``processes``: for
        functions that compute in Python; `fn` must be importable, and a program needs ``if __name__ == "__main__":``. ``ray``: the
        cluster that is connected or found, else a local one.
    workers : int, optional
        Calls at the same time; default: the processors of this process, or those of the cluster.
    results : path, optional
        A file (JSON Lines) to which each row is written when its call has ended. If it exists, seeds that have a row are not called
        again: a sweep that was killed goes on where it was. The function is identified by its name (of a partial one with the
        arguments): after a change of its code, take a new file.
    retry : bool
        Calls seeds again whose row in `results` is a failure.
    progress : bool or callable, optional
        A bar on standard error, or ``progress(done, total)``; default: a bar if it is a terminal.

    Returns
    -------
    list of dict
        A row for each seed, in the order of `seeds`, as ``pandas.DataFrame`` takes it: ``seed``, ``ok``, ``seconds``, ``error`` (None, or
        the exception's last line), and what `fn` returned. Failed rows have a ``traceback``. An exception, or the death of a process,
        ends only the call of its seed.

    Raises
    ------
    MobeeError
        code ``type``, ``bounds``, ``twice``, ``unknown`` (the backend), ``import`` (Ray), ``pickle`` (`fn` can't be sent to a process),
        ``processes`` (no worker starts), ``file``, ``sweep`` (the file is of another function), ``busy`` (another sweep writes it).
    KeyboardInterrupt
        After Ctrl-C, at once. Rows written so far remain; calls in threads end in the background and have no row.
    """
    if not callable(fn):
        raise MobeeError("type", f"fn is {type(fn).__name__}", "fn", "give a function of a seed")
    chosen = _seeds(seeds)
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or not 1 <= workers <= 10_000):
        raise MobeeError("bounds", f"workers is {workers!r}", "workers", "give 1 to 10000")
    if backend not in _BACKENDS:
        raise MobeeError("unknown", f"there is no backend {backend!r}", "backend", 'give "threads", "processes" or "ray"')
    with _results(results, _name(fn)) as (rows, file):
        if retry:
            rows = {seed: row for seed, row in rows.items() if row["ok"]}
        left = [seed for seed in chosen if seed not in rows]
        with _bar(progress, len(chosen)) as advance, closing(_BACKENDS[backend](fn, left, workers)) as ended:
            advance(len(chosen) - len(left), sum(not rows[seed]["ok"] for seed in chosen if seed in rows))
            for row in ended if left else ():
                rows[row["seed"]] = row
                if file is not None:
                    file.write(json.dumps(row) + "\n")
                    file.flush()
                advance(1, int(not row["ok"]))
    return [rows[seed] for seed in chosen]


def _seeds(seeds: Any) -> list[int]:
    try:
        given = list(seeds)
    except TypeError:
        raise MobeeError("type", f"seeds is {type(seeds).__name__}", "seeds", "give integers, such as range(100)") from None
    for i, seed in enumerate(given):
        if isinstance(seed, (bool, np.bool_)) or not isinstance(seed, (int, np.integer)):
            raise MobeeError("type", f"this seed is {seed!r}", f"seeds[{i}]", "give an integer")
    chosen = [int(seed) for seed in given]
    first = dict(zip(reversed(chosen), reversed(range(len(chosen))), strict=True))
    for i, seed in enumerate(chosen):
        if first[seed] != i:
            raise MobeeError("twice", f"the seed {seed} is seeds[{first[seed]}] too", f"seeds[{i}]", "give each seed once")
    return chosen


def _name(fn: Any) -> str:
    """Name of a function in its results; of a partial one with its arguments."""
    if isinstance(fn, functools.partial):
        given = [repr(value) for value in fn.args] + [f"{name}={value!r}" for name, value in sorted(fn.keywords.items())]
        return f"{_name(fn.func)}({', '.join(given)})"
    return str(getattr(fn, "__qualname__", type(fn).__qualname__))


# Results

_HEAD = '{"sweep": '
_REMEDY = "give a file that a sweep wrote, or a new one"

@contextmanager
def _results(path: str | PathLike[str] | None, name: str) -> Iterator[tuple[dict[int, _Row], TextIO | None]]:
    if path is None:
        yield {}, None
        return
    where = Path(fspath(path))
    try:
        file = open(where, "a+", encoding="utf-8")  # noqa: SIM115
    except OSError as e:
        raise MobeeError("file", f"the results can't be opened: {e.strerror}", str(where), "give a file in a folder that exists") from None
    with file:
        _lock(file, where)
        file.seek(0)
        try:
            text = file.read()
        except ValueError:
            raise MobeeError("file", "this is no text", str(where), _REMEDY) from None
        # what follows the last line break was cut off when the sweep was killed
        whole = text[: text.rfind("\n") + 1]
        if not whole and not text.startswith(_HEAD[: len(text)]):
            raise MobeeError("file", "this line is not of a sweep", f"{where}:1", _REMEDY)
        rows = _rows(whole, where, name)
        file.truncate(len(whole.encode()))
        if not whole:
            file.write(json.dumps({"sweep": name}) + "\n")
            file.flush()
        yield rows, file


def _lock(file: TextIO, where: Path) -> None:
    try:
        import fcntl
    except ImportError:
        # not on this system
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        raise MobeeError("busy", "another sweep writes these results", str(where), "wait for it, or give another file") from None


def _rows(text: str, where: Path, name: str) -> dict[int, _Row]:
    rows: dict[int, _Row] = {}
    for n, line in enumerate(text.splitlines()):
        place = f"{where}:{n + 1}"
        try:
            row = json.loads(line)
        except ValueError:
            row = None
        if not isinstance(row, dict) or (row.keys() != {"sweep"} if n == 0 else not {"seed", "ok"} <= row.keys()):
            raise MobeeError("file", "this line is not of a sweep", place, _REMEDY)
        if n > 0:
            rows[row["seed"]] = row
        elif row["sweep"] != name:
            raise MobeeError("sweep", f"these are results of {row['sweep']}, not of {name}", place, "give each function a file of its own")
    return rows


def _one(fn: Callable[[int], Any], seed: int) -> _Row:
    """The row of a seed, as it is after JSON."""
    began = time.monotonic()
    try:
        values = _values(fn(seed))
    except Exception as e:
        text = "".join(traceback.format_exception(e))
        error = traceback.format_exception_only(e)[-1].strip()
        return _failed(seed, time.monotonic() - began, error, text)
    return {"seed": seed, "ok": True, "seconds": round(time.monotonic() - began, 6), "error": None, **values}


def _failed(seed: int, seconds: float, error: str, text: str) -> _Row:
    return {"seed": seed, "ok": False, "seconds": round(seconds, 6), "error": error, "traceback": text}


def _values(result: Any) -> dict[str, Any]:
    values = dict(result) if isinstance(result, Mapping) else {"value": result}
    for name in values:
        if not isinstance(name, str) or name in _OWN:
            raise MobeeError("type", f"the result has the name {name!r}", "fn", f"name values by texts other than {', '.join(_OWN)}")
    try:
        plain: dict[str, Any] = json.loads(json.dumps(values, default=_plain))
    except (TypeError, ValueError) as e:
        raise MobeeError("type", f"the result is no table row: {e}", "fn", "return numbers, texts, lists and dicts") from None
    return plain


def _plain(value: Any) -> Any:
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, PathLike):
        return fspath(value)
    raise TypeError(f"{type(value).__name__} can't be stored")


@contextmanager
def _bar(progress: Any, total: int) -> Iterator[Callable[[int, int], None]]:
    done, failed, began = 0, 0, time.monotonic()
    first: int | None = None
    shown = progress if isinstance(progress, bool) else progress is None and sys.stderr.isatty()

    def advance(count: int, failures: int) -> None:
        nonlocal done, failed, first
        done, failed = done + count, failed + failures
        first = done if first is None else first
        if callable(progress):
            progress(done, total)
        if shown:
            full = _BAR * done // max(total, 1)
            passed = time.monotonic() - began
            left = f", {passed * (total - done) / (done - first):.0f} s left" if done > first else ""
            bad = f", {failed} failed" if failed else ""
            sys.stderr.write(f"\r[{'#' * full}{'.' * (_BAR - full)}] {done} of {total}{bad}{left}\x1b[K")
            sys.stderr.flush()

    try:
        yield advance
    finally:
        if shown:
            sys.stderr.write("\n")


# Backends: each yields rows as they end.


def _processors() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def _threads(fn: Callable[[int], Any], seeds: Sequence[int], workers: int | None) -> _Rows:
    many = min(workers or _processors(), len(seeds))
    pool = ThreadPoolExecutor(many, "mobee-sweep")
    left = list(reversed(seeds))
    try:
        # a thread has its next seed when the row of its last one is stored
        pending: set[Future[_Row]] = {pool.submit(_one, fn, left.pop()) for _ in range(many)}
        while pending:
            done, pending = wait(pending, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
                if left:
                    pending.add(pool.submit(_one, fn, left.pop()))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


class _Worker:
    """A process that calls the function."""

    def __init__(self, code: bytes) -> None:
        context = multiprocessing.get_context("spawn")
        self.line, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs, code), daemon=True)
        self.process.start()
        theirs.close()
        self.seed: int | None = None
        self.began = 0.0
        self.ready = False

    def call(self, seed: int) -> None:
        self.seed, self.began = seed, time.monotonic()
        self.line.send(seed)

    def end(self) -> None:
        self.process.terminate()
        self.process.join(_END_PATIENCE)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.line.close()


def _work(line: Connection, code: bytes) -> None:
    """In a worker: calls the function until the sweep ends, or its process is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        fn = pickle.loads(code)
        line.send(None)
    except Exception as e:
        line.send(traceback.format_exception_only(e)[-1].strip())
        return
    try:
        while True:
            line.send(_one(fn, line.recv()))
    except (EOFError, OSError):
        return


def _processes(fn: Callable[[int], Any], seeds: Sequence[int], workers: int | None) -> _Rows:
    try:
        code = pickle.dumps(fn)
    except Exception as e:
        remedy = 'define fn at the top of a module, or take backend="threads"'
        raise MobeeError("pickle", f"fn can't be sent to a process: {e}", "fn", remedy) from None
    left = list(reversed(seeds))
    crew = [_Worker(code) for _ in range(min(workers or _processors(), len(seeds)))]
    try:
        while crew:
            for line in wait_for([worker.line for worker in crew], _SIGNAL_PERIOD):
                worker = next(worker for worker in crew if worker.line is line)
                row, alive = _heard(worker)
                if row is not None:
                    yield row
                if not alive:
                    worker.end()
                    crew.remove(worker)
                    if len(left) > sum(not other.ready for other in crew):
                        crew.append(_Worker(code))
                elif left:
                    worker.call(left.pop())
                else:
                    crew.remove(worker)
                    worker.end()
    finally:
        for worker in crew:
            worker.end()


def _heard(worker: _Worker) -> tuple[_Row | None, bool]:
    """What a worker sent, and whether it goes on."""
    try:
        message = worker.line.recv()
    except (EOFError, OSError):
        worker.process.join(_END_PATIENCE)
        ended = worker.process.exitcode
        if not worker.ready or worker.seed is None:
            remedy = 'call sweep below `if __name__ == "__main__":`, or take backend="threads"'
            raise MobeeError("processes", f"a worker did not start: exit code {ended}", "backend", remedy) from None
        seed, worker.seed = worker.seed, None
        error = f"the process ended: {f'signal {-ended}' if ended is not None and ended < 0 else f'exit code {ended}'}"
        return _failed(seed, time.monotonic() - worker.began, error, ""), False
    if worker.ready:
        worker.seed = None
        return message, True
    if message is not None:
        remedy = 'define fn at the top of a module, or take backend="threads"'
        raise MobeeError("pickle", f"fn can't be loaded in a process: {message}", "fn", remedy)
    worker.ready = True
    return None, True


def _ray(fn: Callable[[int], Any], seeds: Sequence[int], workers: int | None) -> _Rows:
    try:
        # not by `import`: type checks need not have it
        ray: Any = importlib.import_module("ray")
    except ImportError:
        raise MobeeError("import", "Ray is not installed", "backend", "pip install 'mobee[ray]'") from None
    started = not ray.is_initialized()
    if started:
        ray.init(log_to_driver=False, include_dashboard=False)
    try:
        many = workers or max(int(ray.cluster_resources().get("CPU", 1)), 1)
        call = ray.remote(max_retries=0)(_one)
        code = ray.put(fn)
        left = list(reversed(seeds))
        under_way: dict[Any, tuple[int, float]] = {}
        while left or under_way:
            while left and len(under_way) < many:
                seed = left.pop()
                under_way[call.remote(code, seed)] = (seed, time.monotonic())
            for ref in ray.wait(list(under_way), num_returns=1)[0]:
                seed, began = under_way.pop(ref)
                try:
                    row = ray.get(ref)
                except ray.exceptions.RayError as e:
                    row = _failed(seed, time.monotonic() - began, f"the process ended: {type(e).__name__}", str(e))
                yield row
    finally:
        if started:
            ray.shutdown()


_BACKENDS: dict[str, Callable[[Callable[[int], Any], Sequence[int], int | None], _Rows]] = {
    "threads": _threads,
    "processes": _processes,
    "ray": _ray,
}
