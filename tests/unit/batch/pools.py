"""Workers that are none: chunks are carried out here, at once or in the order of a test."""

from concurrent.futures import Future

from motord.batch.dispatch import ChunkResult
from motord.batch.error import WorkerDiedError


class InlinePool:
    """Carries out each chunk when it is submitted. calls: functions and arguments, in order."""

    def __init__(self):
        self.calls = []
        self.begun = 0

    def begin(self):
        self.begun += 1

    def submit(self, function, *arguments):
        self.calls.append((function, arguments))
        future = Future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future

    def result(self, future):
        return future.result()

    def window(self):
        return 3


class MortalPool:
    """Several workers, each with chunks; `step` ends a chunk or kills a worker with all it has.

    poison: jobs of which a worker dies. taken_s: how long a job takes. most: chunks under way at
    once, at most. deaths: of a chunk. alone: whether nothing else was under way, of each submitted.
    """

    def __init__(self, workers, poison, choose, allowed, taken_s):
        self.poison, self.choose, self.allowed, self.taken_s = poison, choose, allowed, taken_s
        self.workers = [[] for _ in range(workers)]
        self.deaths, self.done, self.most, self.submitted = {}, [], 0, []

    def submit(self, function, chunk):
        future = Future()
        self.submitted.append((chunk, not any(self.workers)))
        self._place(chunk, future)
        self.most = max(self.most, sum(map(len, self.workers)))
        self.deaths[future] = 0
        return future

    def result(self, future):
        return future.result()

    def window(self):
        self._step()
        return 2 * len(self.workers)

    def _place(self, chunk, future):
        self.choose(sorted(self.workers, key=len)[:2]).append((chunk, future))

    def _step(self):
        """Let one worker that has chunks do its first."""
        busy = [chunks for chunks in self.workers if chunks]
        if not busy:
            return
        chunks = self.choose(busy)
        if self.poison.isdisjoint(chunks[0][0]):
            chunk, future = chunks.pop(0)
            self.done += chunk
            taken_s = self.taken_s * len(chunk)
            future.set_result(ChunkResult([10 * job for job in chunk], taken_s))
            return
        lost, chunks[:] = list(chunks), []
        for chunk, future in lost:
            self.deaths[future] += 1
            if self.deaths[future] > self.allowed:
                future.set_exception(WorkerDiedError(f"{chunk}"))
            else:
                self._place(chunk, future)
