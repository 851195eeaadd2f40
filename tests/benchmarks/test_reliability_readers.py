"""The fuzzer itself: inputs are their seed's, most reach past the first parse, and failures are noticed."""

from random import Random

import pytest
from reliability.document_cases import document_cases
from reliability.workers import ReaderCase, examine

from edgemap.geometry.errors import EdgemapError

CHEAP = ("trajectory attachment", "wheel.csv", "times.txt")


def few(scratch):
    return [case for case in document_cases() if case.name in CHEAP]


def test_an_input_is_its_seeds():
    for case in document_cases():
        assert case.make(Random(7)) == case.make(Random(7))


def test_readers_are_examined_and_counted(tmp_path):
    report = examine(few, 0, 100, tmp_path)
    assert report.failures == ()
    results = {result["reader"]: result for result in report.figures["readers"]}
    assert set(results) == set(CHEAP)
    for result in results.values():
        assert 5 < result["accepted"] < 80
        assert result["accepted"] + sum(result["refused"].values()) == result["inputs"] == 100


def test_a_run_that_was_cut_short_goes_on_with_the_next_reader(tmp_path):
    whole = examine(few, 0, 20, tmp_path)
    lines = (tmp_path / "finished.jsonl").read_text().splitlines()
    (tmp_path / "finished.jsonl").write_text("\n".join(lines[:2]) + "\n")
    again = examine(few, 0, 20, tmp_path)
    assert len((tmp_path / "finished.jsonl").read_text().splitlines()) == len(CHEAP)
    counts = [[(row["accepted"], row["refused"]) for row in report.figures["readers"]] for report in (whole, again)]
    assert counts[0] == counts[1]
    examine(few, 1, 20, tmp_path)
    assert len((tmp_path / "finished.jsonl").read_text().splitlines()) == 2 * len(CHEAP)  # another seed, all of them


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (EdgemapError("two\nlines"), "two lines"),
        (EdgemapError("bell \a"), "bell"),
        (KeyError("x"), "KeyError at"),
        (MemoryError(), "MemoryError at"),
        (AssertionError(), "AssertionError at"),
    ],
)
def test_what_is_no_one_line_of_a_typed_error_is_a_failure(tmp_path, error, words):
    def read(folder, data):
        raise error

    report = examine(lambda _: [ReaderCase("broken", lambda random: b"x", read)], 0, 3, tmp_path)
    assert [line for line in report.failures if "3 x" in line and words in line]
