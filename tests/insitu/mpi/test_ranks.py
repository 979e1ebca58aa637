"""Errors on any rank, at any moment, reach all of them, and none waits for ever."""

from __future__ import annotations

import numpy as np
import pytest

from insitu.mpi.ranks import (
    SINGLE,
    CollectiveError,
    Communicator,
    RankError,
    all_or_none,
    call_all,
    ranks_of,
    run_on_root,
)
from tests.support.mpi import on_ranks


class Mailbox:
    """A communicator of one rank that keeps what is sent."""

    def allgather(self, value):
        return [value]

    def Alltoallv(self, sent, received):
        received[0][:] = sent[0]

    def Get_rank(self):
        return 0

    def Get_size(self):
        return 1

    def Is_inter(self):
        return False


def test_results_reach_every_rank_and_commands_run_on_all() -> None:
    def work(ranks):
        done = []
        commands = {"add": lambda a, b: done.append(sum(ranks.gather(a + b + ranks.number))) or done[-1]}
        result = run_on_root(ranks, lambda: [call_all(ranks, commands, "add", n, 10) for n in range(3)], commands)
        return result, done

    assert on_ranks(4, work) == [([46, 50, 54], [46, 50, 54])] * 4


@pytest.mark.parametrize("failing", [0, 1, 3])
@pytest.mark.parametrize("when", ["before", "between", "after"])
def test_a_rank_that_fails_in_a_command_ends_it_on_all(failing, when) -> None:
    def work(ranks):
        def command():
            for moment in ("before", "between", "after"):
                if moment == when and ranks.number == failing:
                    raise ValueError("broken here")
                if moment != "after":
                    ranks.gather(moment)

        commands = {"do": command, "fine": lambda: sum(ranks.gather(1))}

        def leading():
            try:
                call_all(ranks, commands, "do")
                call_all(ranks, commands, "fine")
            except ValueError as error:
                return str(error), call_all(ranks, commands, "fine")
            return "nothing", 0

        return run_on_root(ranks, leading, commands)

    found = on_ranks(4, work)
    assert len(set(found)) == 1
    assert found[0] == (f"rank {failing} of 4: broken here" if failing == 0 else f"rank {failing}: broken here", 4)


def test_a_rank_that_fails_when_all_is_done_returns_what_was_done() -> None:
    def work(ranks):
        def command():
            ranks.gather(None)
            if ranks.number == 2:
                raise OSError("too late")

        return run_on_root(ranks, lambda: call_all(ranks, {"do": command}, "do") or "stored", {"do": command})

    assert on_ranks(3, work) == ["stored"] * 3


@pytest.mark.parametrize("error", [ValueError("wrong"), OSError(28, "No space left"), KeyError("lost")])
def test_what_rank_zero_raises_is_raised_by_all(error) -> None:
    def raising():
        raise error

    found = on_ranks(3, lambda ranks: run_on_root(ranks, raising))
    assert [type(one) for one in found] == [type(error)] * 3
    assert len({str(one) for one in found}) == 1


def test_errors_that_cannot_be_sent_are_told_in_words() -> None:
    class Odd(Exception):
        def __init__(self, one, two):
            super().__init__(f"{one} and {two}")

    def raising():
        raise Odd(1, 2)

    first, second = on_ranks(2, lambda ranks: run_on_root(ranks, raising))
    assert isinstance(first, Odd)
    assert isinstance(second, RankError)
    assert str(second) == "Odd: 1 and 2"


@pytest.mark.parametrize("failing", [0, 2])
def test_work_of_each_rank_fails_on_all(failing) -> None:
    def own(ranks):
        if ranks.number == failing:
            raise ValueError("bad argument")
        return ranks.number

    found = on_ranks(3, lambda ranks: all_or_none(ranks, lambda: own(ranks)))
    assert all(isinstance(one, ValueError) and "bad argument" in str(one) for one in found)
    assert on_ranks(3, lambda ranks: all_or_none(ranks, lambda: ranks.number)) == [0, 1, 2]


def test_alone_nothing_is_exchanged() -> None:
    assert ranks_of(None) is SINGLE
    assert run_on_root(SINGLE, lambda: 3) == 3
    with pytest.raises(ZeroDivisionError):
        run_on_root(SINGLE, lambda: 1 // 0)


def test_one_rank_keeps_the_type_and_the_number_of_its_errors() -> None:
    ranks = Communicator(Mailbox())

    def full():
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left on device") as caught:
        call_all(ranks, {"write": full}, "write")
    assert caught.value.errno == 28


def test_bytes_are_sent_whatever_their_number(monkeypatch) -> None:
    monkeypatch.setattr("insitu.mpi.ranks.LONGEST_PART", 7)
    ranks = Communicator(Mailbox())
    for count in (0, 1, 6, 7, 8, 50):
        data = np.arange(count, dtype=np.uint8)
        np.testing.assert_array_equal(ranks.send([data])[0], data)


def test_what_is_no_communicator_is_refused() -> None:
    class Inter(Mailbox):
        def Is_inter(self):
            return True

    with pytest.raises(TypeError, match=r"comm must be a communicator of mpi4py, such as MPI.COMM_WORLD, got int"):
        ranks_of(7)
    with pytest.raises(ValueError, match="joins two groups of ranks"):
        ranks_of(Inter())


def test_the_first_failing_rank_is_named() -> None:
    class Two(Mailbox):
        def allgather(self, value):
            return [(None, 1), (KeyError("x"), None)]

        def Get_size(self):
            return 2

    with pytest.raises(CollectiveError) as told:
        Communicator(Two()).gather(1)
    assert isinstance(told.value.error, RankError)
    assert str(told.value) == "KeyError: rank 1 of 2: 'x'"
