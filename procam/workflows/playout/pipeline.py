"""An ordered pipeline of threads: read ahead, process in the caller's thread, write behind."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from procam.threads import Future, ThreadPool

Frame = TypeVar("Frame")
Made = TypeVar("Made")
AHEAD_BYTES = 2 * 2**30  # of frames that are read ahead, and as much that wait to be written
MOST_THREADS = 4  # EXR is packed by OpenImageIO's own threads besides


@dataclass(frozen=True, slots=True)
class ThreadPlan:
    """How many threads read and write, and how many frames each side may hold.

    `patience_s` is how long the end waits for each thread: a movie must not be closed
    under it, but a pipe may never answer.
    """

    threads: int
    depth: int
    patience_s: float = 60.0

    def start(self) -> ThreadPool:
        """The threads of one side."""
        return ThreadPool(self.threads, self.patience_s)

    @classmethod
    def for_pictures(cls, frame_bytes: int) -> "ThreadPlan":
        """For files that are read and written independently."""
        threads = max(1, min(MOST_THREADS, (os.cpu_count() or 1) // 2))
        return cls(threads, _depth(2 * threads, frame_bytes))

    @classmethod
    def for_movie(cls, frame_bytes: int) -> "ThreadPlan":
        """For frames that come and go one after the other."""
        return cls(1, _depth(3, frame_bytes))

    @classmethod
    def for_pipe(cls) -> "ThreadPlan":
        """For live frames: what waits is late."""
        return cls(1, 1, 0.5)


def flow(
    reads: Iterable[Callable[[], Frame | None]],
    work: Callable[[Frame], Callable[[], Made]],
    thread_plan: ThreadPlan,
) -> Iterator[Made]:
    """Run frames through: `reads` in threads, `work` here, what it returns in threads; in order.

    A read that gives None ends the flow. At most `thread_plan.depth` frames wait before the work, and as
    many behind it. The first error in the order of the frames is raised here, when all frames before
    it are written.
    """
    jobs = iter(reads)
    ahead: deque[Future[Frame | None]] = deque()
    behind: deque[Future[Made]] = deque()

    def next_frame() -> Frame | None:
        while len(ahead) <= thread_plan.depth and (job := next(jobs, None)) is not None:
            ahead.append(readers.submit(job))
        return ahead.popleft().result() if ahead else None

    with thread_plan.start() as writers, thread_plan.start() as readers:
        try:
            while (frame := next_frame()) is not None:
                behind.append(writers.submit(work(frame)))
                del frame  # its memory is the writer's now
                while behind and (len(behind) > thread_plan.depth or behind[0].done()):
                    yield behind.popleft().result()
        except Exception:
            yield from _results(behind)
            raise
        yield from _results(behind)


def _results(futures: deque[Future[Made]]) -> Iterator[Made]:
    while futures:
        yield futures.popleft().result()


def _depth(wanted: int, frame_bytes: int) -> int:
    return max(1, min(wanted, AHEAD_BYTES // max(frame_bytes, 1)))
