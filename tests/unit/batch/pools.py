"""Workers that are none: jobs are carried out here, at once or in an order that a test chooses."""

from concurrent.futures import Future

from motord.batch.dispatch import WorkerDiedError


class InlinePool:
    """Carries out each job when it is submitted. calls: functions and arguments, in order."""

    def __init__(self):
        self.calls = []

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
    """Several workers, each with some jobs; `step` ends a job or kills a worker with all its jobs.

    poison: jobs of which a worker dies. most: jobs under way at once, at most. deaths: of a job.
    """

    def __init__(self, workers, poison, choose, allowed):
        self.poison, self.choose, self.allowed = poison, choose, allowed
        self.workers = [[] for _ in range(workers)]
        self.deaths, self.done, self.most, self.submitted = {}, [], 0, []

    def submit(self, function, job):
        future = Future()
        self.submitted.append(job)
        self._place(job, future)
        self.most = max(self.most, sum(map(len, self.workers)))
        self.deaths[future] = 0
        return future

    def result(self, future):
        return future.result()

    def window(self):
        self._step()
        return 2 * len(self.workers)

    def _place(self, job, future):
        self.choose(sorted(self.workers, key=len)[:2]).append((job, future))

    def _step(self):
        """Let one worker that has jobs do its first."""
        busy = [jobs for jobs in self.workers if jobs]
        if not busy:
            return
        jobs = self.choose(busy)
        if jobs[0][0] not in self.poison:
            job, future = jobs.pop(0)
            self.done.append(job)
            future.set_result(job * 10)
            return
        lost, jobs[:] = list(jobs), []
        for job, future in lost:
            self.deaths[future] += 1
            if self.deaths[future] > self.allowed:
                future.set_exception(WorkerDiedError(f"{job}"))
            else:
                self._place(job, future)
