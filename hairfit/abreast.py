"""The same work on several photographs at once."""

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

MOST = 8  # each takes memory of its own
Result = TypeVar("Result")


def abreast(
    work: Callable[..., Result], *given: Iterable[Any]
) -> Generator[Result, None, None]:
    """Yield what the work makes of each of what is given, in the order of that.

    As `map`, on as many threads as there are cores: NumPy and SciPy let others run
    while they count. Hardly more is done ahead than threads are busy with, so that what
    was found of many photographs need not be in memory at once. Where one fails, its
    error is raised.

    Args:
        work: What is done; it must change nothing that others use.
        given: As `map` takes them, all of one length.
    """
    count = min(os.cpu_count() or 1, MOST)
    ahead: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(count) as threads:
        for one in zip(*given, strict=True):
            ahead.append(threads.submit(work, *one))
            if len(ahead) > count:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
