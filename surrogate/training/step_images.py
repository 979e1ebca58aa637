"""The images of each step: in shuffled epochs, read ahead by another thread where memory can't hold them."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from surrogate.training.data import Example
from surrogate.training.sampling import ShuffledEpochs

AHEAD = 4  # steps whose images are read before they are due


class StepImages:
    """The images of a process in each step: those at the places `share` of a batch, by the seed and the step alone."""

    def __init__(self, examples: Sequence[Example], seed: int, batch: int, share: Sequence[int]) -> None:
        self._examples, self._seed, self._batch, self._share = examples, seed, batch, share
        self._order = ShuffledEpochs(len(examples), seed)
        self._reader = None if all(e.in_memory for e in examples) else ThreadPoolExecutor(1)
        self._ahead: dict[int, Future[Example]] = {}

    def at(self, step: int, place: int) -> Example:
        """The image at a `place` in the batch of a step, as the catalog has it."""
        return self._examples[self._order[step * self._batch + place]]

    def next(self, step: int, place: int) -> Example:
        """The same in memory; where it has to be read, those of the next steps are read as well."""
        if self._reader is None:
            return self.at(step, place)
        for later in range(step, step + AHEAD + 1):
            for each in self._share:
                number = later * self._batch + each
                if number not in self._ahead and (later, each) >= (step, place):
                    self._ahead[number] = self._reader.submit(self.at(later, each).read)
        return self._ahead.pop(step * self._batch + place).result()
