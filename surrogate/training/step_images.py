"""The images of each step: in shuffled epochs, smaller ones first, read ahead by another thread where memory can't hold them."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from surrogate.training.data import Example
from surrogate.training.downsampling import Downsampling, downsampled
from surrogate.training.sampling import ShuffledEpochs

AHEAD = 4  # steps whose images are read before they are due
WHOLE = Downsampling(1, 0)
MEMORY = 1 << 29  # bytes of downsampled images that are kept for the next epochs


def share_in_memory(bytes_of_all: float) -> float:
    """The share of downsampled images that memory holds."""
    return min(1.0, MEMORY / bytes_of_all)


class StepImages:
    """The images of a process in each step: those at the places `share` of a batch, by the seed and the step alone."""

    def __init__(
        self,
        examples: Sequence[Example],
        seed: int,
        batch: int,
        share: Sequence[int],
        downsampling: Downsampling = WHOLE,
    ) -> None:
        self._examples, self._seed, self._batch, self._share = examples, seed, batch, share
        self._order = ShuffledEpochs(len(examples), seed)
        self._reader = None if all(e.in_memory for e in examples) else ThreadPoolExecutor(1)
        self._ahead: dict[int, Future[Example]] = {}
        self._downsampling, self._small, self._factor = downsampling, dict[int, Example](), 1

    def at(self, step: int, place: int) -> Example:
        """The image at a `place` in the batch of a step, as the catalog has it."""
        return self._examples[self._number(step, place)]

    def next(self, step: int, place: int) -> Example:
        """The same in memory, downsampled in early steps; where it has to be read, those of the next steps are read as well."""
        if self._reader is None:
            return self._read(self._number(step, place), self._downsampling.at(step))
        for later in range(step, step + AHEAD + 1):
            for each in self._share:
                due = later * self._batch + each
                if due not in self._ahead and (later, each) >= (step, place):
                    number, factor = self._number(later, each), self._downsampling.at(later)
                    self._ahead[due] = self._reader.submit(self._read, number, factor)
        return self._ahead.pop(step * self._batch + place).result()

    def _number(self, step: int, place: int) -> int:
        """Of the image among the examples; not for the reader's thread."""
        return self._order[step * self._batch + place]

    def _read(self, number: int, factor: int) -> Example:
        if factor != self._factor:
            self._small, self._factor = {}, factor
        example = self._examples[number]
        if factor == 1:
            return example.read()
        if number in self._small:
            return self._small[number]
        small = downsampled(example.read(), factor)
        if small.camera is not example.camera and (len(self._small) + 1) * small.pixels.nbytes <= MEMORY:
            self._small[number] = small
        return small
